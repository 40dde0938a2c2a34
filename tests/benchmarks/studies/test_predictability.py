"""Predictability of motion: deviations and fractions by hand, and held-out learners."""

from pathlib import Path

import numpy as np
import pytest

from geovp_benchmarks.progress import no_progress
from geovp_classic.data import pose_files
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory
from studies import predictability
from studies.predictability import Predictability, Ridge, Windows
from tests.benchmarks.conftest import Says

STUDY = Predictability()
HORIZONS = np.array(STUDY.horizons)


def drive(speed_m_s: FloatArray, turn_rad_s: FloatArray) -> Trajectory:
    """Return poses along speeds [T] and turn rates [T], 10 a second."""
    twists = np.zeros((len(speed_m_s), 6))
    twists[:, 2] = speed_m_s
    twists[:, 4] = turn_rad_s
    poses = [np.eye(4)]
    for step in se3.exp(0.1 * twists):
        poses.append(poses[-1] @ step)
    return Trajectory(np.stack(poses), 0.1 * np.arange(len(poses)), True)


def winding(count: int, phase: float) -> Trajectory:
    """Return a drive at 8 m/s whose turn rate is a sine with a period of 6 s."""
    turn_rad_s = 0.3 * np.sin(np.arange(count) * 0.1 * 2 * np.pi / 6 + phase)
    return drive(np.full(count, 8.0), turn_rad_s)


def test_deviations_are_along_and_across_the_turn_and_over_its_plane() -> None:
    observed = drive(np.full(9, 10.0), np.zeros(9))
    right = np.array([[0.0, 0.0, np.pi / 2]])  # base: a camera that has turned to the right
    shift, turn = (
        se3.exp(np.array(v)) for v in ([0.5, 0.1, 2, 0, 0, 0], [0, 0, 0, 0, np.pi / 2, 0])
    )
    pose = observed.world_from_cam[-1] @ shift @ turn
    # 0.5 m to its right is along the base, 2 m ahead is to the left of the base; 0.1 m lower
    expected = [[0.5, -2.0, 0.1, 0, 0, 0]]
    result = predictability.deviations(pose[None], observed, right)
    np.testing.assert_allclose(result, expected, atol=1e-9)


def test_a_steady_turn_does_not_deviate_and_a_braking_car_falls_behind() -> None:
    steady = drive(np.full(80, 8.0), np.full(80, 0.2))
    assert np.abs(STUDY.windows({"a": steady}, 10, no_progress).truth).max() < 1e-6
    # brakes by 2 m/s^2 from the last pose on: behind by 0.02 m (1 + ... + k)
    speed_m_s = np.append(np.full(30, 10.0), 10 - 0.2 * np.arange(1, 30))
    braking = STUDY.windows({"a": drive(speed_m_s, 0 * speed_m_s)}, 100, no_progress)
    assert braking.truth[0, :, 0] == pytest.approx(-0.01 * HORIZONS * (HORIZONS + 1))


def test_a_held_out_learner_explains_what_depends_on_the_past_alone() -> None:
    rng = np.random.default_rng(0)
    twists = rng.standard_normal((400, STUDY.num_steps, 6))
    truth = np.zeros((400, len(HORIZONS), 6))
    truth[..., 5] = 0.1 * twists[:, -1, 4:5] * HORIZONS  # yaw follows the last turn rate
    truth[..., 4] = rng.standard_normal((400, 1))  # roll is chance
    sequences = np.repeat(["a", "b", "c", "d"], 100)
    windows = Windows(sequences, twists, truth, truth)
    predicted = Ridge(9, 0.03).held_out(windows, ["a"])
    is_tested = sequences == "a"
    assert np.isnan(predicted[~is_tested]).all()
    yaw, roll = (
        predictability.explained_fraction(
            truth[is_tested, 2, i], predicted[is_tested, 2, i], sequences[is_tested]
        )
        for i in (5, 4)
    )
    assert yaw.low > 0.6
    assert roll.mean < 0.05
    other = truth.copy()
    other[is_tested] = 7.0  # the tested sequence is not fitted to
    changed = Windows(sequences, twists, other, other)
    np.testing.assert_array_equal(Ridge(9, 0.03).held_out(changed, ["a"]), predicted)


def test_an_explained_fraction_by_hand() -> None:
    truth = np.array([1.0, -1.0, 2.0, -2.0] * 10)
    sequences = np.repeat("a", 40)
    half = predictability.explained_fraction(truth, 0.5 * truth, sequences)
    assert [half.mean, half.low, half.high] == pytest.approx([0.75] * 3)
    assert predictability.explained_fraction(truth, -truth, sequences).mean == pytest.approx(-3.0)


def test_the_command_prints_a_row_per_component_and_learner(tmp_path: Path, printed: Says) -> None:
    for name in ("01", "02"):
        recorded = winding(150, int(name))
        pose_files.write_kitti(tmp_path / f"{name}.txt", recorded)
        (tmp_path / f"{name}_times.txt").write_text("\n".join(map(str, recorded.times_s)))
    options = ["--sequences", "01", "--fit", "01", "02", "--stride", "10"]
    lines = printed("study", "predictability", tmp_path, *options).splitlines()
    rows = [line.split("|")[1].strip() for line in lines if line.startswith("| yaw:")]
    assert rows == ["yaw: linear, 0.9 s", "yaw: linear, 3 s", "yaw: shipped motion prior"]
