from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from geovp_classic import registry
from geovp_classic.contracts import checks, street
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import ByteArray, Clip, Grant, Trajectory
from geovp_learned import checkpoints
from geovp_learned.synsin import pairs
from geovp_learned.synsin.network import Generator
from geovp_learned.synsin.renderer import SynSin
from geovp_learned.synsin.train import SynSinTraining

NUM_PAST = 6


@pytest.fixture(scope="module")
def overfitted(method: SynSinTraining, clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A weights file of a network that knows the last of the past frames, and what comes after it, by heart."""
    torch.manual_seed(0)
    networks = method.build()
    optimisers = method.optimisers(networks)
    batch = pairs.batch([pairs.frame_pairs(pairs.Example(clip, NUM_PAST - 1), [0, 1, 2, 3, 4])])
    for step in range(150):
        for turn, losses in method.training_step(networks, batch, step):
            optimisers[turn].zero_grad()
            losses["total"].backward()
            optimisers[turn].step()
    file = tmp_path_factory.mktemp("weights") / "overfitted.safetensors"
    checkpoints.write(file, "synsin", method, networks, {"seconds": 1})
    return file


@pytest.fixture
def fresh(method: SynSinTraining, tmp_path: Path) -> Path:
    """A weights file of an untrained network."""
    torch.manual_seed(0)
    file = tmp_path / "fresh.safetensors"
    checkpoints.write(file, "synsin", method, {"generator": Generator(method.architecture)}, {})
    return file


def past_of(clip: Clip) -> Trajectory:
    return clip.trajectory[:NUM_PAST]


def rms(one: ByteArray, other: ByteArray) -> float:
    """In bytes."""
    return float(np.sqrt(((one.astype(float) - other) ** 2).mean()))


def test_after_overfitting_the_frames_own_pose_gives_the_frame_back_and_later_poses_the_later_frames(
    overfitted: Path, clip: Clip
) -> None:
    context, target = clip.split(NUM_PAST, Grant.NONE)
    scene = SynSin(overfitted).reconstruct(context, past_of(clip))
    views = scene.view(clip.trajectory.world_from_cam[NUM_PAST - 1 :], clip.times_s[NUM_PAST - 1 :], clip.intrinsics)
    last = context.frames[-1]
    assert rms(last, target.frames[-1]) > 25  # copying the last frame would not do
    assert rms(views.frames[0], last) < 10
    assert views.covered[0].all()
    for step in range(4):
        assert rms(views.frames[1 + step], target.frames[step]) < 0.6 * rms(last, target.frames[step])


def test_depths_are_those_of_the_new_views(overfitted: Path, clip: Clip) -> None:
    context, _ = clip.split(NUM_PAST, Grant.NONE)
    views = (
        SynSin(overfitted)
        .reconstruct(context, past_of(clip))
        .view(clip.trajectory.world_from_cam[NUM_PAST - 1 :], clip.times_s[NUM_PAST - 1 :], clip.intrinsics)
    )
    for step in (0, 2):
        truth = clip.depths[NUM_PAST - 1 + step]
        compared = views.covered[step] & (truth < 30)
        assert compared.sum() > 200
        error = np.abs(1 / views.depths[step][compared] - 1 / truth[compared])
        assert np.median(error) < 0.02  # 1/m


def test_what_no_point_reaches_is_not_covered(fresh: Path, clip: Clip) -> None:
    context, _ = clip.split(NUM_PAST, Grant.NONE)
    past = past_of(clip)
    scene = SynSin(fresh).reconstruct(context, past)
    sideways = past.world_from_cam[-1] @ se3.exp(np.array([0, 0, 0, 0, np.arctan(16 / clip.intrinsics.fx_px), 0]))
    behind = past.world_from_cam[-1] @ np.diag([-1.0, 1.0, -1.0, 1.0])
    views = scene.view(np.stack([sideways, behind]), clip.times_s[-2:], clip.intrinsics)
    assert views.covered[0, 16, :12].all()  # half the image has gone out on the left
    assert not views.covered[0, 16, 20:].any()
    assert not views.covered[1].any()
    assert not views.depths[~views.covered].any()


def test_the_new_camera_may_have_another_size(fresh: Path, clip: Clip) -> None:
    context, _ = clip.split(NUM_PAST, Grant.NONE)
    past = past_of(clip)
    views = (
        SynSin(fresh)
        .reconstruct(context, past)
        .view(past.world_from_cam[-1:], past.times_s[-1:], clip.intrinsics.resized(40, 24))
    )
    assert views.frames.shape == (1, 24, 40, 3)


def test_it_keeps_the_promises_of_a_renderer(fresh: Path) -> None:
    findings = checks.check("renderers", registry.build("renderers", {"name": "synsin", "checkpoint": str(fresh)}))
    assert [finding for finding in findings if not finding.passed] == []
    refusal = "refuses: synsin's depth is in metres, the poses are not: give the odometry a scale"
    assert findings[-1].detail == refusal


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(
    method: SynSinTraining, clip: Clip, tmp_path: Path
) -> None:
    generator = Generator(method.architecture)
    for parameter in generator.refinement_network.parameters():
        torch.nn.init.normal_(parameter, std=0.3)  # untrained, it would not let the noise through
    checkpoints.write(tmp_path / "noisy.safetensors", "synsin", method, {"generator": generator}, {})
    context, _ = clip.split(NUM_PAST, Grant.NONE)

    def seen(seed: int) -> ByteArray:
        scene = SynSin(tmp_path / "noisy.safetensors", seed=seed).reconstruct(context, past_of(clip))
        return scene.view(past_of(clip).world_from_cam[-2:], clip.times_s[-2:], clip.intrinsics).frames

    np.testing.assert_array_equal(seen(1), seen(1))
    assert (seen(1) != seen(2)).any()


def damaged(file: Path, how: str, method: SynSinTraining) -> Path:
    """A weights file with one fault."""
    other = file.with_name(f"{how}.safetensors")
    generator = Generator(method.architecture)
    if how == "truncated":
        other.write_bytes(file.read_bytes()[:-100])
    elif how == "text":
        other.write_text("not a weights file, but a long enough text to be looked at")
    elif how == "method":
        checkpoints.write(other, "deepvo", method, {"generator": generator}, {})
    elif how == "size":
        wider = replace(method, architecture=replace(method.architecture, width=20))
        checkpoints.write(other, "synsin", wider, {"generator": generator}, {})
    elif how == "infinite":
        next(generator.parameters()).data.fill_(torch.inf)
        checkpoints.write(other, "synsin", method, {"generator": generator}, {})
    return other


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("missing", "do not exist"),
        ("truncated", "does not match its own checksum"),
        ("text", "is not a whole safetensors file"),
        ("method", "deepvo, expected geovp-weights-1, synsin"),
        ("size", "size mismatch"),
        ("infinite", "not finite"),
    ],
)
def test_a_file_that_cannot_be_used_gets_one_sentence(
    fresh: Path, method: SynSinTraining, how: str, message: str
) -> None:
    with pytest.raises(BadData, match=message) as refusal:
        SynSin(damaged(fresh, how, method))
    assert "\n" not in str(refusal.value)
    assert f"{how}.safetensors" in str(refusal.value)


def test_frames_of_other_sizes_are_encoded_at_their_own(fresh: Path) -> None:
    clip = street.clip()  # 128x128, where the network was made for 32
    context, _ = clip.split(NUM_PAST, Grant.NONE)
    scene = SynSin(fresh).reconstruct(context, clip.trajectory[:NUM_PAST])
    views = scene.view(clip.trajectory.world_from_cam[NUM_PAST - 1 : NUM_PAST], clip.times_s[:1], clip.intrinsics)
    assert rms(views.frames[0], context.frames[-1]) < 1
