"""What can be foreseen: deviations and noise by hand, learners and cues on scenes whose answer is
known.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geovp_benchmarks.progress import no_progress
from geovp_classic.data import pose_files
from geovp_classic.geometry import se3
from geovp_classic.geometry.ground_plane import GroundPlane
from geovp_classic.types import FloatArray, Intrinsics, Trajectory
from studies.foreseeable import images, learners, windows
from studies.foreseeable.windows import HORIZONS, Windows
from tests.benchmarks.conftest import Says

CAMERA = Intrinsics(200.0, 200.0, 127.5, 127.5, 256, 256)
LEVEL = GroundPlane(np.array([0.0, 1.0, 0.0]), 1.65)
AHEAD = np.outer(np.arange(21.0), [0.0, 0.0, 1.0])  # 1 m a step


def drive(twists: FloatArray) -> Trajectory:
    """Poses along twists [T, 6] per second, 10 a second."""
    poses = [np.eye(4)]
    for twist in twists:
        poses.append(poses[-1] @ se3.exp(0.1 * twist))
    return Trajectory(np.stack(poses), 0.1 * np.arange(len(poses)), True)


def winding(count: int, seed: int) -> Trajectory:
    """A drive at 8 m/s whose turn rate is a sine of a period of 6 s."""
    turn = 0.3 * np.sin(np.arange(count) * 0.1 * 2 * np.pi / 6 + seed)
    zero = np.zeros(count)
    return drive(np.stack([zero, zero, np.full(count, 8.0), zero, turn, zero], axis=1))


def test_deviations_are_along_and_across_the_turn_and_over_its_plane() -> None:
    past = drive(np.tile([0.0, 0, 10, 0, 0, 0], (30, 1)))
    last = past.world_from_cam[-1]
    right = np.array(
        [[0.0, 0.0, np.pi / 2]]
    )  # the baseline looks to the right, at the last camera's place
    pose = (
        last
        @ se3.exp(np.array([0.5, 0.1, 2.0, 0, 0, 0]))
        @ se3.exp(np.array([0, 0, 0, 0, np.pi / 2, 0]))
    )
    found = windows.deviations(pose[None], past, right)[0]
    # 0.5 m to its right is along the baseline, 2 m ahead is to the baseline's left; 0.1 m lower
    np.testing.assert_allclose(found, [0.5, -2.0, 0.1, 0, 0, 0], atol=1e-9)


def test_a_steady_turn_leaves_nothing_and_a_braking_car_falls_behind() -> None:
    assert (
        np.abs(windows.read({"a": drive(np.tile([0.0, 0, 8, 0, 0.2, 0], (80, 1)))}, 10).truth).max()
        < 1e-6
    )
    speed = np.append(
        np.full(30, 10.0), 10 - 0.2 * np.arange(1, 30)
    )  # brakes by 2 m/s^2 from the last pose on
    braking = drive(
        np.stack([0 * speed, 0 * speed, speed, 0 * speed, 0 * speed, 0 * speed], axis=1)
    )
    found = windows.read({"a": braking}, 100)
    assert found.truth[0, :, 0] == pytest.approx(
        [-0.01 * k * (k + 1) for k in HORIZONS]
    )  # 0.02 (1 + ... + k)


def test_noise_of_poses_is_found_beside_smooth_motion() -> None:
    count, deviation = 3000, np.array([0.003, 0.002, 0.004, 3e-4, 1e-4, 5e-4])
    shaken = windows.with_noise(winding(count, 0), deviation, seed=1)
    noisy = Trajectory(shaken, 0.1 * np.arange(count + 1), True)
    np.testing.assert_allclose(windows.pose_noise(noisy), deviation, rtol=0.15)
    assert windows.pose_noise(winding(count, 0)).max() < 1e-5


@pytest.fixture(scope="module")
def known() -> Windows:
    """400 windows of four sequences whose yaw follows the last turn rate and whose roll is chance."""
    rng = np.random.default_rng(0)
    twists = rng.standard_normal((400, windows.LONG_STEPS, 6))
    truth = np.zeros((400, len(HORIZONS), 6))
    truth[..., 5] = 0.1 * twists[:, -1, 4:5] * HORIZONS
    truth[..., 4] = rng.standard_normal((400, 1))
    return Windows(np.repeat(["a", "b", "c", "d"], 100), twists, truth, truth, truth, truth)


@pytest.mark.parametrize(
    "learner", [learners.Ridge(), learners.SmallNetwork(num_members=1, epochs=40)]
)
def test_learners_explain_what_the_past_tells_and_nothing_else(
    learner: learners.Ridge | learners.SmallNetwork, known: Windows
) -> None:
    answers = learners.held_out(learner, known, ["a", "b"], no_progress)
    asked = np.isin(known.sequences, ["a", "b"])
    assert np.isnan(answers[~asked]).all()
    yaw, roll = (
        learners.explained(
            known.truth[asked, 2, one], answers[asked, 2, one], known.sequences[asked]
        )
        for one in (5, 4)
    )
    assert yaw.low > 0.6
    assert roll.mean < 0.05


def test_the_asked_sequence_is_not_fitted_to(known: Windows) -> None:
    other = known.truth.copy()
    other[known.sequences == "a"] = 7.0
    changed = Windows(known.sequences, known.twists, other, other, other, other)
    before, after = (
        learners.held_out(learners.Ridge(), one, ["a"], no_progress) for one in (known, changed)
    )
    np.testing.assert_array_equal(before, after)


def test_an_explained_share_by_hand() -> None:
    truth, sequences = np.array([1.0, -1.0, 2.0, -2.0] * 10), np.repeat("a", 40)
    share = learners.explained(truth, 0.5 * truth, sequences)
    assert share.mean == pytest.approx(0.75)
    assert (share.low, share.high) == (
        pytest.approx(0.75),
        pytest.approx(0.75),
    )  # the same share of all
    assert learners.explained(truth, -truth, sequences).mean == pytest.approx(-3.0)


def test_a_cue_is_asked_about_blocks_that_it_was_not_fitted_to() -> None:
    rng, count = np.random.default_rng(0), 400
    roll = rng.standard_normal((count, 1))
    residuals = np.zeros((count, len(HORIZONS), 6))
    residuals[..., 4], residuals[..., 5] = -roll, rng.standard_normal((count, 1))
    cues = {
        name: roll + 5.0 if cue.is_centred else rng.standard_normal((count, 1))
        for name, cue in images.CUES.items()
    }
    starts, sequences = 3 * np.tile(np.arange(count // 2), 2), np.repeat(["a", "b"], count // 2)
    read = images.CueWindows(cues, residuals, sequences, starts)
    truth, said = images.held_out(read, "roll of the road's plane")
    assert learners.explained(truth[:, 4], said[:, 4], sequences).low > 0.8
    truth, said = images.held_out(read, "clearance of arcs")
    assert learners.explained(truth[:, 4], said[:, 4], sequences).mean < 0.02
    assert images.correlations(read, "roll of the road's plane")["a"] == pytest.approx(-1, abs=0.02)


def test_the_command_writes_its_page_and_keeps_the_notes(tmp_path: Path, printed: Says) -> None:
    for name in ("01", "02"):
        recorded = winding(150, int(name))
        pose_files.write_kitti(tmp_path / f"{name}.txt", recorded)
        (tmp_path / f"{name}_times.txt").write_text(
            "\n".join(f"{time:.6f}" for time in recorded.times_s)
        )
    page = tmp_path / "page.md"
    page.write_text("old\n\n## Notes\n\nStays.\n")
    words = [
        "study",
        "foreseeable",
        tmp_path,
        "--sequences",
        "01",
        "--fit",
        "01",
        "02",
        "--stride",
        "10",
    ]
    told = printed(*words, "--page", page)
    text = page.read_text()
    assert told.strip() in text
    assert text.startswith(
        "# What can be foreseen\n\n```sh\npython benchmarks/studies foreseeable path/to/poses\n```\n"
    )
    assert text.endswith("## Notes\n\nStays.\n")
    rows = [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("| yaw:")]
    assert rows == [
        f"yaw: {one}"
        for one in ("constant velocity", *learners.LEARNERS, "motion prior, as shipped")
    ]
    assert "depth" not in text
