"""`geovp poses`: drift and files of sequences, errors of known wrong steps on clips."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import geovp_classic as geovp
from geovp_benchmarks.evaluation.odometry import step_errors
from geovp_classic.data import pose_files
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, Clip, Context, Intrinsics, PrivilegedInput, Trajectory
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import intrinsics_of


def drive(num_frames: int) -> Clip:
    """Return black images, one metre a frame straight ahead."""
    times_s = np.arange(num_frames) / 10
    poses = se3.exp(np.outer(np.arange(num_frames), [0.0, 0, 1, 0, 0, 0]))
    frames = np.zeros((num_frames, 8, 8, 3), dtype=np.uint8)
    camera = Intrinsics(8, 8, 3.5, 3.5, 8, 8)
    return Clip("drive", frames, times_s, camera, Trajectory(poses, times_s, is_metric=True))


@dataclass(frozen=True)
class Skewed:
    """Odometry with errors of 3 degrees, 10 % of the length, and 4 degrees to the right."""

    is_metric: bool = True
    needs = PrivilegedInput.NONE

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        assert context.past is None
        aside = np.radians(4)
        step = se3.exp(np.array([0, 0, 0, 0, np.radians(3), 0]))
        step[:3, 3] = 1.1 * np.array([np.sin(aside), 0, np.cos(aside)])
        poses = np.stack([np.linalg.matrix_power(step, k) for k in range(context.num_past)])
        is_tracked = np.arange(context.num_past) != 1
        times_s = context.times_s[: context.num_past]
        return Trajectory(poses, times_s, self.is_metric), is_tracked


def test_wrong_steps_are_measured() -> None:
    is_tracked, rotation, direction, length = step_errors(Skewed(), drive(6), num_past=5)
    assert is_tracked.tolist() == [False, True, True, True]
    np.testing.assert_allclose(rotation, [3.0] * 4)
    np.testing.assert_allclose(direction, [4.0] * 4)
    np.testing.assert_allclose(length, [10.0])


def test_a_path_without_metres_has_no_length() -> None:
    *_, length = step_errors(Skewed(is_metric=False), drive(6), num_past=5)
    assert np.isnan(length).all()


def test_the_command_prints_a_row_per_stretch(street: Path, printed: Says) -> None:
    data = f'{{root = "{street}", stride = 2, size_px = [160, 160]}}'
    words = ["poses", data, "07[0:12)", "07[2:12)", "--clips", "8"]
    head, *rows = printed(*words).splitlines()
    assert "rotation (deg/frame)" in head
    assert [row.split()[:2] for row in rows] == [["07[0:12)", "2"], ["07[2:12)", "1"]]
    assert float(rows[0].split()[3]) < 0.2  # degrees a frame


@pytest.mark.parametrize(("name", "length"), [("tum", "0.0"), ("euroc", "0.0"), ("colmap", "-")])
def test_other_layouts_are_recognised_by_their_files(
    tmp_path: Path,
    name: str,
    length: str,
    request: pytest.FixtureRequest,
    printed: Says,
    refused: Says,
) -> None:
    """Recorded poses have no error against themselves; a COLMAP model has no metric scale."""
    clip = geovp.open_clip({"name": "synthetic", "num_frames": 8, "size_px": [32, 32]})
    request.getfixturevalue(f"write_{name}")(tmp_path, "a", clip)
    data = f'root = "{tmp_path}", stride = 3, size_px = [32, 32]'
    if name == "tum":
        data += f", intrinsics = {intrinsics_of(clip.intrinsics)}"
    words = ["a", "--clips", "4", "--odometry", "ground-truth"]
    last = printed("poses", f"{{{data}}}", *words).splitlines()[-1]
    assert last.split() == ["a[0:8)", "2", "100.0%", "0.0000", "0.00", length]
    assert printed("doctor", tmp_path).splitlines()[1].startswith("a         8       32x32")
    assert "has no field 'colour'" in refused("poses", f"{{{data}, colour = 1}}", *words)


def test_files_and_drift_of_a_short_stretch(street: Path, tmp_path: Path, printed: Says) -> None:
    lines = printed("poses", street, "07[2:12)", "--out", tmp_path).splitlines()
    by_alignment = {words[0]: words[1:] for line in lines if (words := line.split())}
    assert {"origin", "scale", "se3", "sim3"} <= set(by_alignment)
    # ten metres have no segment of 100 m
    assert by_alignment["sim3"][:4] == ["too", "short", "too", "short"]
    assert float(by_alignment["sim3"][4]) < 0.5  # ATE in metres
    name = "07-000002-000012"
    poses = pose_files.read_kitti(tmp_path / f"{name}.kitti.txt")
    stamped = pose_files.read_trajectory(tmp_path / f"{name}.tum.txt")
    assert len(poses) == len(stamped) == 10
    np.testing.assert_allclose(stamped.world_from_cam, poses, atol=1e-6)
    np.testing.assert_allclose(stamped.times_s[0], 0.2, atol=1e-6)


def test_without_a_scale_no_metres_are_printed(street: Path, tmp_path: Path, printed: Says) -> None:
    odometry = '{name = "monocular", scale = "unit-speed"}'
    text = printed("poses", street, "07", "--odometry", odometry, "--out", tmp_path)
    rows = [line.split() for line in text.splitlines()]
    assert ["origin", "no", "metric", "scale"] in [row[:4] for row in rows]
    assert next(row for row in rows if row[:1] == ["sim3"])[5].replace(".", "").isdigit()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["99"], "99"),
        (["07[5:50)"], "07 has 12 frames"),
        (["07", "--odometry", "monoclar"], "did you mean 'monocular'"),
        (["07", "--odometry", "ground-truth"], "works on clips only"),
    ],
)
def test_mistakes_get_a_sentence(
    street: Path, tmp_path: Path, refused: Says, arguments: list[str], message: str
) -> None:
    assert message in refused("poses", street, *arguments, "--out", tmp_path)
    assert not list(tmp_path.iterdir())
