"""The channels and layers of the authors' repository, written out as numbers."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from geovp_classic.errors import BadData
from geovp_classic.types import Clip, PrivilegedInput
from geovp_learned import checkpoints, training_config
from geovp_learned.feature_networks import vgg19
from geovp_learned.synsin import losses
from geovp_learned.synsin.renderer import SynSin
from geovp_learned.synsin.train import SynSinTraining


@pytest.fixture(scope="module")
def tiny() -> SynSinTraining:
    return training_config.load("synsin", Path("synsin-toy")).method


def test_it_trains_by_the_same_loop_and_its_weights_make_a_row(
    trained: Callable[..., Any], tiny: SynSinTraining, clip: Clip, tmp_path: Path
) -> None:
    networks, _ = trained(tiny, tiny.examples([tiny.prepare(clip)], training=True)[:2], num_steps=2)
    torch.manual_seed(0)
    for name, fresh in tiny.build().items():
        before = dict(fresh.named_parameters())
        still = [key for key, p in networks[name].named_parameters() if torch.equal(p, before[key])]
        # of those before a normalisation it does not matter
        assert not [key for key in still if "bias" not in key]
    file = tmp_path / "synsin.safetensors"
    checkpoints.write(file, "synsin", tiny, {"generator": networks["generator"]}, {})
    context, target = clip.split(6, PrivilegedInput.FUTURE_POSES | PrivilegedInput.PAST_POSES)
    renderer = SynSin(weights=file)
    assert renderer.input_note == "works on the last frame, at its own size"
    first, second = (
        renderer.reconstruct(context, context.past).view(
            target.trajectory.world_from_cam, target.trajectory.times_s, clip.intrinsics
        )
        for _ in range(2)
    )
    assert first.frames.shape == (4, 32, 32, 3)
    np.testing.assert_array_equal(first.frames, second.frames)  # noise is drawn from the seed


@pytest.fixture
def vgg_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Tensor]:
    """Random weights of VGG-19 that are downloaded as the real ones are."""
    torch.manual_seed(0)
    weights = vgg19().state_dict()
    file = tmp_path / "vgg.pth"
    torch.save({**weights, "classifier.0.weight": torch.zeros(1)}, file)
    digits = hashlib.sha256(file.read_bytes()).hexdigest()[:8]
    monkeypatch.setattr(losses, "VGG19", file.rename(tmp_path / f"vgg-{digits}.pth").as_uri())
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "home"))
    return weights


def test_content_is_compared_in_five_layers_of_vgg(vgg_weights: dict[str, Tensor]) -> None:
    frames = torch.rand(2, 2, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    shares, stages, expected = iter((1 / 32, 1 / 16, 1 / 8, 1 / 4, 1)), (0, 5, 10, 19, 28), 0.0
    now = 2 * frames.flatten(0, 1) - 1
    for layer in range(29):
        if layer in (4, 9, 18, 27):
            now = nn.functional.max_pool2d(now, 2)
        if f"features.{layer}.weight" in vgg_weights:
            kernel, bias = (vgg_weights[f"features.{layer}.{part}"] for part in ("weight", "bias"))
            now = nn.functional.conv2d(now, kernel, bias, padding=1).relu()
        if layer in stages:
            expected += next(shares) * float((now[:2] - now[2:]).abs().mean())
    given = frames[0].requires_grad_()
    loss = losses.content_loss(given, frames[1], "vgg19")
    assert float(loss.detach()) == pytest.approx(expected, rel=1e-5)
    loss.backward()
    assert given.grad.abs().max() > 0


def test_without_the_weights_of_vgg_the_message_says_where_they_belong(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    losses.vgg19_network.cache_clear()
    monkeypatch.setattr(losses, "VGG19", (tmp_path / "vgg19-dcbb9e9d.pth").as_uri())
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "home"))
    with pytest.raises(BadData, match=r"cannot be downloaded .* into hub/checkpoints/vgg19"):
        losses.content_loss(torch.rand(1, 3, 32, 32), torch.rand(1, 3, 32, 32), "vgg19")
