"""Hugging Face depth networks: tiny ones with random weights in local folders."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from geovp_classic import registry
from geovp_classic.errors import BadData

transformers = pytest.importorskip("transformers", reason="needs the extra 'pretrained'")


def test_a_local_network_predicts_as_transformers_does(
    tmp_path: Path, write_huggingface: Callable[[Path], Path]
) -> None:
    """Frames of 84 x 56 pixels keep their size and aspect, so that only normalisation is left."""
    folder = write_huggingface(tmp_path)
    source = registry.build("depth_sources", {"name": "huggingface", "model": str(folder)})
    frames = np.random.default_rng(0).integers(0, 256, (2, 56, 84, 3), np.uint8)
    output = source.predict(frames)
    network = transformers.AutoModelForDepthEstimation.from_pretrained(folder).eval()
    mean, std = np.array([[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]])
    images = torch.tensor((frames / 255 - mean) / std).float().permute(0, 3, 1, 2)
    with torch.inference_mode():
        expected = network(pixel_values=images).predicted_depth.numpy()
    assert output.shape == (2, 56, 84)
    np.testing.assert_allclose(output, expected, rtol=1e-4, atol=1e-6)


def test_models_of_the_hub_need_a_pinned_revision(tmp_path: Path) -> None:
    for revision in ("", "main"):
        with pytest.raises(BadData, match="40 digits"):
            registry.build(
                "depth_sources",
                {"name": "huggingface", "model": "depth-anything/X", "revision": revision},
            )
    with pytest.raises(BadData, match="safetensors"):
        registry.build("depth_sources", {"name": "huggingface", "model": str(tmp_path)})


def test_changed_weights_of_a_folder_change_the_component(
    tmp_path: Path, write_huggingface: Callable[[Path], Path]
) -> None:
    """Stored scores are found by the described settings, so these must differ."""
    spec = {"name": "huggingface", "model": str(write_huggingface(tmp_path))}
    before = registry.build("depth_sources", spec)
    stored = registry.describe(before)
    frames = np.random.default_rng(0).integers(0, 256, (1, 56, 56, 3), np.uint8)
    output = before.predict(frames)
    assert registry.build("depth_sources", stored) == before
    assert before.fingerprint in before.weights_note
    network = transformers.AutoModelForDepthEstimation.from_pretrained(tmp_path)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter += 0.1
    network.save_pretrained(tmp_path)
    after = registry.build("depth_sources", spec)
    assert registry.describe(after) != stored
    assert np.abs(after.predict(frames) - output).max() > 1e-3
    with pytest.raises(BadData, match="fingerprint"):
        registry.build("depth_sources", stored)
