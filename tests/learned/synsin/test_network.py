"""The channels and layers of the authors' repository, written out as numbers."""

import hashlib
from collections.abc import Callable
from itertools import pairwise
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
from geovp_learned.synsin import losses, pairs
from geovp_learned.synsin.generator import Generator
from geovp_learned.synsin.network import NOISE_SIZE
from geovp_learned.synsin.renderer import SynSin
from geovp_learned.synsin.splatting import Splatter
from geovp_learned.synsin.train import SynSinTraining

FEATURE_CHANNELS = (3, 32, 32, 32, 64, 64, 64, 64, 64)
REFINEMENT_CHANNELS = (64, 64, 128, 256, 256, 128, 128, 128, 3)
RESAMPLED_BLOCKS = (1, 2, 4, 5)  # two halve, two double
DOWN = (3, 32, 64, 128, 256, 256, 256, 256, 256)
UP = ((256, 256), (512, 256), (512, 256), (512, 256), (512, 128), (256, 64), (128, 32), (64, 1))


def numbers_of_blocks(channels: tuple[int, ...], resampled: tuple[int, ...] = ()) -> int:
    total = 0
    for index, (a, b) in enumerate(pairwise(channels)):
        total += 9 * a * b + b + 9 * b * b + b  # two 3x3 convolutions
        total += 2 * 20 * (a + b)  # gain and bias of two normalisations from 20 numbers of noise
        total += a * b + b if a != b or index in resampled else 0  # 1x1 beside them
    return total


@pytest.fixture(scope="module")
def networks() -> dict[str, nn.Module]:
    torch.manual_seed(0)
    return {name: network.eval() for name, network in SynSinTraining().build().items()}


@pytest.fixture(scope="module")
def tiny() -> SynSinTraining:
    return training_config.load("synsin", Path("synsin-toy")).method


def count(network: nn.Module) -> int:
    return sum(parameter.numel() for parameter in network.parameters())


def test_one_setting_gives_the_papers_layers(networks: dict[str, nn.Module]) -> None:
    generator = networks["generator"]
    assert isinstance(generator, Generator)
    assert count(generator.feature_network) == numbers_of_blocks(FEATURE_CHANNELS) == 431_064
    assert count(generator.refinement_network) == numbers_of_blocks(
        REFINEMENT_CHANNELS, RESAMPLED_BLOCKS
    )
    convolutions = sum(16 * a * b + b for a, b in pairwise(DOWN)) + sum(
        9 * a * b + b for a, b in UP
    )
    normalised = sum(DOWN[2:-1]) + sum(
        b for _, b in UP[:-1]
    )  # not the U-Net's first, innermost and last layer
    assert count(generator.depth_network) == convolutions + 2 * normalised
    scale = (
        (48 * 64 + 64) + 16 * (64 * 128 + 128 * 256 + 256 * 512) + (16 * 512 + 1)
    )  # no bias before a normalisation
    assert count(networks["discriminator"]) == 2 * scale


def test_sizes_within_the_networks_are_the_papers(networks: dict[str, nn.Module]) -> None:
    generator = networks["generator"]
    sizes: list[tuple[int, ...]] = []
    note: Callable[..., None] = lambda _, __, output: sizes.append(tuple(output.shape[1:]))  # noqa: E731
    depth = dict(generator.depth_network.named_children())
    watched = [*generator.refinement_network.blocks, *(depth[f"conv{n}"] for n in range(1, 9))]
    handles = [module.register_forward_hook(note) for module in watched]
    with torch.no_grad():
        generator.refinement_network(torch.rand(1, 64, 256, 256), torch.zeros(1, NOISE_SIZE))
        inverse_depths = generator.depth_network(torch.rand(1, 3, 256, 256))
    for handle in handles:
        handle.remove()
    sides = (256, 128, 64, 64, 128, 256, 256, 256)
    assert sizes[:8] == [
        (c, side, side) for c, side in zip(REFINEMENT_CHANNELS[1:], sides, strict=True)
    ]
    assert sizes[8:] == [(c, 256 >> k, 256 >> k) for k, c in enumerate(DOWN[1:], 1)]  # down to 1x1
    assert float(inverse_depths.min()) > 1 / 50
    assert float(inverse_depths.max()) < 1 / 5  # about 10 m before training


def test_depth_does_not_see_the_camera_and_holes_stay_empty(
    tiny: SynSinTraining, clip: Clip
) -> None:
    generator = tiny.build()["generator"].eval()
    frames, camera = torch.rand(1, 3, 34, 30), pairs.intrinsics_tensor(clip.intrinsics)
    one, other = (
        generator.encode(frames, c, torch.zeros(1, NOISE_SIZE)) for c in (camera, 2 * camera)
    )
    assert one.features.shape == (1, 34 * 30, 8)
    torch.testing.assert_close(one.inverse_depths, other.inverse_depths)
    maps: list[Tensor] = []
    generator.refinement_network.register_forward_hook(lambda _, given, __: maps.append(given[0]))
    away = torch.eye(4)[None]
    away[0, 0, 3] = 1e4  # everything leaves the image
    images = generator.render(one, away, camera, (34, 30), torch.zeros(1, NOISE_SIZE))
    assert generator.splatter(34) == Splatter(34 * 4 / 256, 128, 0.001**0.5)
    assert not maps[0].any()
    assert not images.opacities.any()
    assert images.frames.shape == (1, 3, 34, 30)
    assert (images.frames - 0.5).abs().max() <= 0.5  # a tanh


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
