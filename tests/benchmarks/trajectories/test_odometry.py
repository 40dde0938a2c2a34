"""`geovp poses`: drift and files of sequences, errors of known wrong steps on clips."""

from pathlib import Path

import numpy as np
import pytest

from geovp_benchmarks.trajectories.odometry import TrackedPath
from geovp_classic.data.formats import pose_files
from geovp_classic.geometry import se3
from geovp_classic.types import Clip, Intrinsics, Trajectory
from tests.benchmarks.conftest import Says


def drive(num_frames: int) -> Clip:
    """Return black images, one metre a frame straight ahead."""
    times_s = np.arange(num_frames) / 10
    poses = se3.exp(np.outer(np.arange(num_frames), [0.0, 0, 1, 0, 0, 0]))
    frames = np.zeros((num_frames, 8, 8, 3), dtype=np.uint8)
    camera = Intrinsics(8, 8, 3.5, 3.5, 8, 8)
    return Clip("drive", frames, times_s, camera, Trajectory(poses, times_s, is_metric=True))


def skewed(is_metric: bool) -> TrackedPath:
    """Return the drive with errors of 3 degrees and of 10 % of the length of each step."""
    truth = drive(5).trajectory
    step = se3.exp(np.array([0, 0, 0, 0, np.radians(3), 0]))
    step[2, 3] = 1.1
    poses = np.stack([np.linalg.matrix_power(step, k) for k in range(5)])
    return TrackedPath(Trajectory(poses, truth.times_s, is_metric), np.ones(5, bool), truth)


def test_wrong_steps_are_measured() -> None:
    t_rel, r_rel, ate_m, rpe_m, rpe_deg = skewed(is_metric=True).errors("origin")
    assert np.isnan([t_rel, r_rel]).all()  # four metres have no segment of 100 m
    assert ate_m > np.sqrt(0.3 / 5)  # 0 to 0.4 m of length; the turn adds to it
    assert rpe_m == pytest.approx(0.1)
    assert rpe_deg == pytest.approx(3.0)


def test_a_path_without_metres_has_errors_at_a_fitted_scale_alone() -> None:
    path = skewed(is_metric=False)
    assert np.isnan(path.errors("origin")).all()
    _, _, ate_m, _, rpe_deg = path.errors("sim3")
    assert ate_m < 0.1  # the length is right, the turn is not
    assert rpe_deg == pytest.approx(3.0)


def by_alignment(lines: list[str]) -> dict[str, list[str]]:
    """Return the cells of the last table by its first column."""
    rows = [line.strip("| ").split("|") for line in lines if line.startswith("|")]
    return {name.strip(): [cell.strip() for cell in cells] for name, *cells in rows}


def test_the_command_prints_a_table_per_stretch(street: Path, printed: Says) -> None:
    data = f'{{root = "{street}", stride = 2, size_px = [160, 160]}}'
    words = ["poses", data, "07[0:12)", "07[2:12)", "--clips", "8"]
    lines = printed(*words).splitlines()
    heads = [line for line in lines if not line.startswith("|")]
    assert heads == [
        "07[0:12): 2 clips, 100.0% of frames tracked",
        "07[2:12): 1 clips, 100.0% of frames tracked",
    ]
    assert float(by_alignment(lines)["sim3"][4]) < 0.2  # degrees a frame


def test_files_and_drift_of_a_short_stretch(street: Path, tmp_path: Path, printed: Says) -> None:
    lines = printed("poses", street, "07[2:12)", "--out", tmp_path).splitlines()
    errors = by_alignment(lines)
    assert {"origin", "scale", "se3", "sim3"} <= errors.keys()
    # Ten metres have no segment of 100 m.
    assert errors["sim3"][:2] == ["-", "-"]
    assert float(errors["sim3"][2]) < 0.5  # ATE in metres
    name = "07-000002-000012"
    poses = pose_files.read_kitti(tmp_path / f"{name}.kitti.txt")
    stamped = pose_files.read_trajectory(tmp_path / f"{name}.tum.txt")
    assert len(poses) == len(stamped) == 10
    np.testing.assert_allclose(stamped.world_from_cam, poses, atol=1e-6)
    np.testing.assert_allclose(stamped.times_s[0], 0.2, atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["99"], "99"),
        (["07[5:50)", "--every", "2"], "07 has 6 frames"),
        (["07", "--odometry", "monoclar"], "did you mean 'monocular'"),
        (["07", "--odometry", "ground-truth"], "give --clips N"),
    ],
)
def test_mistakes_get_a_sentence(
    street: Path, tmp_path: Path, refused: Says, arguments: list[str], message: str
) -> None:
    data = f'{{root = "{street}", frame_step = 5}}'
    assert message in refused("poses", data, *arguments, "--out", tmp_path)
    assert not list(tmp_path.iterdir())
