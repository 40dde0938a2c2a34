"""ONNX files as components: tiny networks whose output is known."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import street

from geovp_classic import registry
from geovp_classic.types import PrivilegedInput, Views

pytest.importorskip("onnx", reason="needs the extra 'onnx'")
pytest.importorskip("onnxruntime", reason="needs the extra 'pretrained'")
CLIP = street.clip()
NUM_PAST = 6


@pytest.mark.parametrize(
    ("shape", "axis"), [([1, 32, 48, 3], 3), ([1, 3, 32, 48], 1), (["n", 3, "h", "w"], 1)]
)
def test_images_are_resized_normalised_and_batched(
    tmp_path: Path, write_onnx: Callable[..., Path], shape: list[Any], axis: int
) -> None:
    """The mean over channels of (image - mean) / std, in [0, 1], of two frames of one colour."""
    path = write_onnx(tmp_path / "mean.onnx", {"image": shape}, mean_axis=axis)
    settings = {"mean": [0.1, 0.2, 0.3], "std": [0.5, 0.5, 0.25], "size_px": [48, 32]}
    source = registry.build("depth_sources", {"name": "onnx", "path": str(path), **settings})
    assert source.weights_note.startswith(f"onnx weights mean.onnx {source.fingerprint} on cpu")
    frames = np.full((2, 64, 64, 3), 51, np.uint8)
    frames[1] = 102
    output = source.predict(frames)
    assert output.shape == (2, 32, 48)
    np.testing.assert_allclose(output[0], (0.2 + 0.0 - 0.4) / 3, atol=1e-6)
    np.testing.assert_allclose(output[1], (0.6 + 0.4 + 0.4) / 3, atol=1e-6)


def test_metric_output(tmp_path: Path, write_onnx: Callable[..., Path]) -> None:
    """A network whose metres are the brightness."""
    path = write_onnx(tmp_path / "mean.onnx", {"image": [1, 3, 32, 32]})
    settings = {"name": "onnx", "path": str(path), "values": "depth"}
    context, _ = CLIP.split(NUM_PAST, PrivilegedInput.NONE)
    past = CLIP.trajectory[:NUM_PAST]
    source = registry.build("depth_sources", {**settings, "align": False, "frames": [-1, 2]})
    inverse_depths, confidence = source.inverse_depths(context, past)
    brightness = context.frames[2].mean() / 255
    assert 1 / inverse_depths[2].mean() == pytest.approx(brightness, rel=0.2)
    assert confidence.any(axis=(1, 2)).tolist() == [False, False, True, False, False, True]


def test_holes_are_inpainted_and_covered_pixels_stay(
    tmp_path: Path, write_onnx: Callable[..., Path]
) -> None:
    """The network returns 0.2 in the mask and the image, which is black in holes, elsewhere."""
    inputs = {"mask": [1, 1, 16, 16], "image": [1, 3, 16, 16]}
    path = write_onnx(tmp_path / "paint.onnx", inputs)
    inpainter = registry.build("inpainters", {"name": "onnx", "path": str(path)})
    frames = np.full((2, 32, 32, 3), 200, np.uint8)
    covered = np.ones((2, 32, 32), bool)
    covered[:, 8:24, 8:24] = False
    covered[1] = False
    views = Views(frames, covered, covered.astype(np.float32))
    last = np.full((32, 32, 3), 7, np.uint8)
    inpainted = inpainter.inpaint(views, last)
    np.testing.assert_array_equal(inpainted[0][covered[0]], 200)
    np.testing.assert_array_equal(inpainted[0, 12:20, 12:20], 51)
    np.testing.assert_array_equal(inpainted[1], last)
