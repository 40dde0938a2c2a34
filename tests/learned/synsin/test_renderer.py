from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from geovp_classic.geometry import se3
from geovp_classic.types import (
    ByteArray,
    Clip,
    FloatArray,
    PrivilegedInput,
    Trajectory,
    Views,
)
from geovp_learned import checkpoints
from geovp_learned.stored_clips import Window
from geovp_learned.synsin import pairs
from geovp_learned.synsin.renderer import SynSin
from geovp_learned.synsin.residual import ResidualGenerator
from geovp_learned.synsin.train import SynSinTraining

NUM_PAST = 6


@pytest.fixture(scope="module")
def overfitted(
    trained: Callable[..., Any],
    method: SynSinTraining,
    clip: Clip,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """A weights file of a network that knows by heart what comes two steps after the last of the
    past frames, and after the next one.
    """
    networks, _ = trained(
        method,
        [Window(pairs.prepare(clip), NUM_PAST - 1), Window(pairs.prepare(clip), NUM_PAST)],
        100,
    )
    file = tmp_path_factory.mktemp("weights") / "overfitted.safetensors"
    checkpoints.write(file, "synsin", method, networks, {"seconds": 1})
    return file


def past_of(clip: Clip) -> Trajectory:
    return clip.trajectory[:NUM_PAST]


def views_of(file: Path, clip: Clip, world_from_cam: FloatArray, seed: int = 0) -> Views:
    """The last of the past frames, rendered from the poses."""
    context, _ = clip.split(NUM_PAST, PrivilegedInput.NONE)
    scene = SynSin(file, seed=seed).reconstruct(context, past_of(clip))
    return scene.view(world_from_cam, clip.times_s[-len(world_from_cam) :], clip.intrinsics)


def rms(one: ByteArray, other: ByteArray) -> float:
    """In bytes."""
    return float(np.sqrt(((one.astype(float) - other) ** 2).mean()))


def test_after_overfitting_it_also_shows_poses_that_it_was_not_shown_and_their_depths(
    overfitted: Path, clip: Clip
) -> None:
    views = views_of(overfitted, clip, clip.trajectory.world_from_cam[NUM_PAST - 1 :])
    last, later = clip.frames[NUM_PAST - 1], clip.frames[NUM_PAST:]
    assert rms(last, later[-1]) > 25  # copying the last frame would not do
    assert rms(views.frames[0], last) < 10
    assert views.covered[0].all()
    for step in range(4):
        assert rms(views.frames[1 + step], later[step]) < 0.6 * rms(last, later[step])
    for step in (0, 2):
        truth = clip.depths[NUM_PAST - 1 + step]
        compared = views.covered[step] & (truth < 30)
        assert compared.sum() > 200
        error = np.abs(1 / views.depths[step][compared] - 1 / truth[compared])
        assert np.median(error) < 0.02  # 1/m


def test_what_no_point_reaches_is_not_covered(overfitted: Path, clip: Clip) -> None:
    last = past_of(clip).world_from_cam[-1]
    sideways = last @ se3.exp(np.array([0, 0, 0, 0, np.arctan(16 / clip.intrinsics.fx_px), 0]))
    behind = last @ np.diag([-1.0, 1.0, -1.0, 1.0])
    views = views_of(overfitted, clip, np.stack([sideways, behind]))
    assert views.covered[0, 16, :12].all()  # half the image has gone out on the left
    assert not views.covered[0, 16, 20:].any()
    assert not views.covered[1].any()
    assert not views.depths[~views.covered].any()


def test_several_views_at_once_are_those_one_by_one(overfitted: Path, clip: Clip) -> None:
    context, _ = clip.split(NUM_PAST, PrivilegedInput.NONE)
    scene = SynSin(overfitted).reconstruct(context, past_of(clip))
    poses = torch.eye(4).repeat(3, 1, 1)
    poses[:, 2, 3] = torch.tensor([0.0, -0.5, -1.0])
    together = scene.rendered(poses, clip.intrinsics)
    single = [scene.rendered(pose[None], clip.intrinsics) for pose in poses]
    for number, several in enumerate(together):
        alone = np.concatenate([view[number] for view in single])
        np.testing.assert_allclose(several.astype(float), alone, rtol=1e-4, atol=1)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(
    method: SynSinTraining, clip: Clip, tmp_path: Path
) -> None:
    generator = ResidualGenerator(method.architecture)
    for parameter in generator.refinement_network.parameters():
        torch.nn.init.normal_(parameter, std=0.3)  # untrained, it would not let the noise through
    checkpoints.write(
        tmp_path / "noisy.safetensors", "synsin", method, {"generator": generator}, {}
    )
    poses = past_of(clip).world_from_cam[-2:]
    first, again, other = (
        views_of(tmp_path / "noisy.safetensors", clip, poses, seed=seed).frames
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
