"""Trajectories survive a round trip through text, and every bad line is named."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from geovp_classic.data.findings import Findings
from geovp_classic.data.formats import pose_files
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import Trajectory

IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0"
twists = arrays(np.float64, (5, 6), elements=st.floats(-1e4, 1e4)).map(
    lambda t: t * [1, 1, 1, 1e-4, 1e-4, 1e-4]
)
steps_s = arrays(np.float64, (5,), elements=st.floats(2e-3, 5.0))
same_folder = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50, deadline=None
)


@same_folder
@given(twists, steps_s)
def test_files_give_back_the_trajectory_that_was_written(
    tmp_path: Path, twist: np.ndarray, step_s: np.ndarray
) -> None:
    trajectory = Trajectory(se3.exp(twist), np.cumsum(step_s), is_metric=True)
    for write in (pose_files.write_tum, pose_files.write_kitti):
        write(tmp_path / "poses.txt", trajectory)
        again = pose_files.read_trajectory(tmp_path / "poses.txt", trajectory.times_s)
        np.testing.assert_allclose(
            again.world_from_cam, trajectory.world_from_cam, rtol=0, atol=1e-9
        )
        np.testing.assert_array_equal(again.times_s, trajectory.times_s)


def test_a_quarter_turn_to_the_right_is_read_as_tum_writes_it(tmp_path: Path) -> None:
    half = np.sqrt(0.5)  # 90 degrees about y (down): z, forward, turns to x, right
    (tmp_path / "tum.txt").write_text(f"# t x y z qx qy qz qw\n\n1.5 10 20 30 0 {half} 0 {half}\n")
    trajectory = pose_files.read_trajectory(tmp_path / "tum.txt")
    expected = [[0, 0, 1, 10], [0, 1, 0, 20], [-1, 0, 0, 30], [0, 0, 0, 1]]
    np.testing.assert_allclose(trajectory.world_from_cam[0], expected, atol=1e-12)
    assert trajectory.times_s.tolist() == [1.5]


@pytest.mark.parametrize(
    ("header", "order"),
    [
        ("timestamp,tx,ty,tz,qx,qy,qz,qw", (0, 1, 2, 3)),
        ("%time;x;y;z;q_x;q_y;q_z;q_w", (0, 1, 2, 3)),
        ("timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x []", (3, 0, 1, 2)),
        ("#t, x, y, z, qw, qx, qy, qz", (3, 0, 1, 2)),
    ],
)
def test_a_header_names_the_order_of_columns(
    header: str, order: tuple[int, ...], tmp_path: Path
) -> None:
    """The quaternion (0.6, 0, 0, 0.8) turns y about x to (0, .28, .96)."""
    path = tmp_path / "poses.csv"
    quaternion = np.array([0.6, 0, 0, 0.8])[list(order)]
    path.write_text(f"{header}\n" + ",".join(map(str, [1.5, 10, 20, 30, *quaternion])))
    assert pose_files.has_times(path)
    (pose,) = pose_files.read_trajectory(path).world_from_cam
    np.testing.assert_allclose(pose[:3, 1], [0, 0.28, 0.96], atol=1e-12)


def test_thirteen_numbers_start_with_the_frame_index(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(f"0 {IDENTITY}\n\n# lost\n1 {IDENTITY}  # found again\n")
    assert pose_files.read_kitti(path).shape == (2, 4, 4)
    assert pose_files.read_trajectory(path, np.arange(2) / 10).times_s.tolist() == [0, 0.1]
    for index in ("-1", "1.5", "0", "2"):
        path.write_text(f"0 {IDENTITY}\n{index} {IDENTITY}\n")
        with pytest.raises(BadData, match=f"line 2: frame index {index}, expected 1"):
            pose_files.read_kitti(path)


def test_seven_printed_digits_are_made_rigid(tmp_path: Path) -> None:
    numbers = """9.999978e-01 5.272628e-04 -2.066935e-03 -4.690294e-02
        -5.296506e-04 9.999992e-01 -1.154865e-03 -2.839928e-02
        2.066324e-03 1.155958e-03 9.999971e-01 8.586941e-01"""
    (tmp_path / "poses.txt").write_text(" ".join(numbers.split()))
    world_from_cam = pose_files.read_kitti(tmp_path / "poses.txt")
    rotation = world_from_cam[0, :3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    assert world_from_cam[0, 2, 3] == 0.8586941


BAD_TUM = {
    "1 0 0 0 0 0 0": "7 numbers, expected 8",
    "1 0 0 0 0 0 0 2": "the quaternion has length 2, expected 1",
    "1 0 0 0 0 0 0 0": "the quaternion has length 0, expected 1",
    "0 0 0 0 0 0 0 1": "0.0 is not after 0.0",
}
BAD_KITTI = {
    "1 0 0 0 0 1 0 0 0 0 1": "11 numbers, expected 12",
    f"5 {IDENTITY}": "13 numbers, expected 12",
    "1,0 0,0 0 0 0 1 0 0 0 0 1 0": "14 numbers, expected 12: write decimals with a point",
    "nan 0 0 0 0 1 0 0 0 0 1 0": "'nan' is not a finite number",
    "1 0 0 zero 0 1 0 0 0 0 1 0": "'zero' is not a finite number",
    "2 0 0 0 0 1 0 0 0 0 1 0": "a rotation matrix is off by 3",
    "1 0 0 0 0 1 0 0 0 0 -1 0": "a rotation matrix is a mirror, as of left-handed axes",
    "0 0 0 0 0 0 0 0 0 0 0 0": "a rotation matrix is off by 1",
}


@pytest.mark.parametrize("bad", [*BAD_KITTI, *BAD_TUM])
def test_a_bad_line_is_named(tmp_path: Path, bad: str) -> None:
    path = tmp_path / "poses.txt"
    is_kitti = bad in BAD_KITTI
    read = pose_files.read_kitti if is_kitti else pose_files.read_tum
    first, last = [IDENTITY] * 2 if is_kitti else ("0 0 0 0 0 0 0 1", "2 0 0 0 0 0 0 1")
    path.write_text(f"{first}\n{bad}\n{last}\n")
    message = {**BAD_KITTI, **BAD_TUM}[bad]
    with pytest.raises(BadData, match=f"poses.txt line 2: {message}"):
        read(path)
    findings = Findings()
    world_from_cam = read(path, findings) if is_kitti else read(path, findings)[1]
    assert [finding.line for finding in findings] == [2]
    assert np.isfinite(world_from_cam[:, 0, 0]).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"# nothing but this\n\n", "has no numbers"),
        (b"\x89PNG\xff\xfe", "cannot be read as text"),
        (b"0 0 0 0 0 0 0 1\n100 0 0 0 0 0 0 1", "as of times in ms: give times in s"),
    ],
)
def test_files_without_poses_or_text_are_refused(
    content: bytes, message: str, tmp_path: Path
) -> None:
    (tmp_path / "poses.txt").write_bytes(content)
    with pytest.raises(BadData, match=message):
        pose_files.read_trajectory(tmp_path / "poses.txt")


def test_the_format_is_that_of_the_first_line(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(f"{IDENTITY}\n")
    with pytest.raises(BadData, match="KITTI's format, which has no times"):
        pose_files.read_trajectory(path)


def test_a_folder_is_no_file_to_write(tmp_path: Path) -> None:
    trajectory = Trajectory(np.eye(4)[None], np.array([0.0]), is_metric=True)
    with pytest.raises(BadData, match="cannot be written"):
        pose_files.write_tum(tmp_path, trajectory)
