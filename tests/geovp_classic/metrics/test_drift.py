"""Drift, ATE and RPE: worked examples, invariances, and agreement with evo (run in its own
process).
"""

import json
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geovp_classic.data.formats import pose_files
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.metrics import drift
from geovp_classic.types import Trajectory


def drive(twists: np.ndarray) -> Trajectory:
    """Steps of the given twists [T - 1, 6] from a world origin that is not the identity."""
    poses = [se3.exp(np.array([3.0, 1, -2, 0.1, 0.4, -0.2]))]
    for step in se3.exp(twists):
        poses.append(poses[-1] @ step)
    return Trajectory(np.array(poses), np.arange(len(poses)) * 0.1, True)


def straight(steps: int, step_m: float = 1.0, yaw_rad: float = 0.0) -> Trajectory:
    return drive(np.tile([0, 0, step_m, 0, yaw_rad, 0], (steps, 1)))


def wobbly(seed: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    return drive(rng.normal(size=(60, 6)) * [0.1, 0.05, 0.2, 0.01, 0.05, 0.01] + [0, 0, 1, 0, 0, 0])


def test_five_percent_too_fast_drifts_five_percent() -> None:
    measured = drift.kitti_drift(straight(400, 1.05), straight(400))
    # The first frame *farther* than the length is 101 m away on a 1 m grid: 101 * 0.05 m / 100 m,
    # 201 * ... and so on.
    expected = np.mean([5 * (n + 1) / n for n in (100, 200, 300) for _ in range(0, 400 - n, 10)])
    assert measured.translation_percent == pytest.approx(expected, rel=1e-6)
    assert measured.rotation_deg_per_100m == pytest.approx(0, abs=1e-5)
    assert measured.num_segments == 30 + 20 + 10


def test_constant_yaw_drift_is_counted_per_metre() -> None:
    # 0.01 degrees at every metre: 1.01 degrees after the 101 steps of a segment of 100 m, and 2.01,
    # 3.01.
    measured = drift.kitti_drift(straight(400, yaw_rad=np.deg2rad(0.01)), straight(400))
    expected = np.mean([(n + 1) / n for n in (100, 200, 300) for _ in range(0, 400 - n, 10)])
    assert measured.rotation_deg_per_100m == pytest.approx(expected, rel=1e-3)


def test_a_short_path_has_no_drift() -> None:
    measured = drift.kitti_drift(straight(99), straight(99))
    assert str(measured) == "too short"
    assert np.isnan([measured.translation_percent, measured.rotation_deg_per_100m]).all()
    assert str(drift.kitti_drift(straight(400), straight(400))) == "0.00 % / 0.000 deg/100m"


def test_alignment_removes_its_transform() -> None:
    truth = wobbly(1)
    for how in drift.ALIGNMENTS:
        moved = se3.exp(np.array([9.0, -4, 2, 0.5, -1, 0.3])) @ truth.world_from_cam
        moved[:, :3, 3] *= 3 if how in ("scale", "sim3") else 1
        estimate = Trajectory(moved, truth.times_s, False)
        assert drift.absolute_error_m(drift.aligned(estimate, truth, how), truth).max() < 1e-6


def test_unequal_lengths_and_units_are_refused() -> None:
    with pytest.raises(BadData, match="3 estimated poses for 4 real ones"):
        drift.absolute_error_m(straight(2), straight(3))
    with pytest.raises(BadData, match="expected 1 to 3"):
        drift.relative_error(straight(3), straight(3), num_steps=4)
    with pytest.raises(BadData, match="not in metres"):
        drift.kitti_drift(straight(400), replace(straight(400), is_metric=False))


def evo(tool: str, folder: Path, *options: str) -> float:
    """The root mean square that evo finds for estimate.txt against truth.txt."""
    program = Path(sys.executable).with_name(tool)
    if not program.exists():
        pytest.skip("evo is not installed: pip install 'geovp[dev]'")
    result = folder / "result.zip"
    result.unlink(missing_ok=True)
    command = [
        str(program),
        "tum",
        "truth.txt",
        "estimate.txt",
        "--save_results",
        str(result),
        *options,
    ]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, env={"HOME": str(folder)}
    )
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(result) as stored:
        return float(json.loads(stored.read("stats.json"))["rmse"])


def test_agreement_with_evo(tmp_path: Path) -> None:
    truth = wobbly(1)
    noisy = wobbly(2).world_from_cam.copy()
    noisy[:, :3, 3] *= 1.3
    estimate = Trajectory(noisy, truth.times_s, False)
    pose_files.write_tum(tmp_path / "truth.txt", truth)
    pose_files.write_tum(tmp_path / "estimate.txt", estimate)
    for how, options in (
        ("origin", ["--align_origin"]),
        ("scale", ["--align_origin", "--correct_scale"]),
        ("se3", ["--align"]),
        ("sim3", ["--align", "--correct_scale"]),
    ):
        ours = drift.root_mean_square(
            drift.absolute_error_m(drift.aligned(estimate, truth, how), truth)
        )
        assert ours == pytest.approx(evo("evo_ape", tmp_path, *options), rel=1e-5), how
    translation, rotation_deg = drift.relative_error(estimate, truth, num_steps=5)
    steps = ["--delta", "5", "--delta_unit", "f", "--all_pairs"]
    assert drift.root_mean_square(translation) == pytest.approx(
        evo("evo_rpe", tmp_path, *steps), rel=1e-5
    )
    angle = evo("evo_rpe", tmp_path, *steps, "--pose_relation", "angle_deg")
    assert drift.root_mean_square(rotation_deg) == pytest.approx(angle, rel=1e-5)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_step_too_long_in_any_direction_is_a_relative_error(axis: int) -> None:
    twists = np.tile([0.3, 0.2, 1.0, 0, 0, 0], (20, 1))
    wrong = twists + 0.05 * np.eye(6)[axis]
    np.testing.assert_allclose(
        drift.relative_error(drive(wrong), drive(twists))[0], 0.05, atol=1e-9
    )
    np.testing.assert_allclose(
        drift.relative_error(drive(wrong), drive(twists), 4)[0], 0.2, atol=1e-9
    )
