"""KITTI raw: poses from GPS and IMU readings, cameras, times, and errors of a damaged drive."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import street

from geovp_classic.data.doctor import Doctor
from geovp_classic.data.findings import RAISE
from geovp_classic.data.layouts import kitti_raw
from geovp_classic.data.layouts.kitti_raw import KittiRaw
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3

Edit = Callable[[Path, int, str], None]
Write = Callable[..., Path]
NAME = "2011_09_26_drive_0007"
DRIVE = f"2011_09_26/{NAME}_sync"


@pytest.fixture
def root(tmp_path: Path, write_kitti_raw: Write) -> Path:
    """The contracts' street as drive 0007, seen by camera 2."""
    write_kitti_raw(tmp_path / "raw", 7, street.clip())
    return tmp_path / "raw"


def raw(root: Path, **settings: object) -> KittiRaw:
    """Return the data set of clips of 4 frames, 32 pixels wide."""
    return KittiRaw(root, **{"num_frames": 4, "stride": 2, "size_px": (32, 32), **settings})


def test_a_circle_in_latitude_and_longitude_is_a_circle_of_poses() -> None:
    # 50 m round, counter-clockwise from its southernmost point, where a car drives east; worked out
    # on the sphere
    angle = np.radians(np.arange(0, 360, 15.0))
    east_m, north_m = 50 * np.sin(angle), 50 * (1 - np.cos(angle))
    radius_m = 6378137.0
    latitude = 49.0 + np.degrees(north_m / radius_m)
    longitude = 8.4 + np.degrees(east_m / (radius_m * np.cos(np.radians(49.0))))
    still = np.zeros_like(angle)
    readings = np.stack([latitude, longitude, 100 + angle, still, still, angle], axis=-1)
    poses = kitti_raw.mercator_poses(readings)
    positions = np.stack([east_m, north_m, angle], axis=-1)
    np.testing.assert_allclose(poses[:, :3, 3], positions, atol=2e-3)
    # towards the centre of the circle, 50 m to the left of every pose
    np.testing.assert_allclose((poses @ [0, 50, 0, 1])[:, :2], np.tile([0, 50], (24, 1)), atol=2e-3)


def test_roll_pitch_and_yaw_turn_as_documented() -> None:
    cos, sin, quarter = np.cos(0.1), np.sin(0.1), np.pi / 2
    for angles, axis, expected in (
        ((0.1, 0, 0), (0, 1, 0), (0, cos, sin)),  # roll: left goes up
        ((0, 0.1, 0), (1, 0, 0), (cos, 0, -sin)),  # pitch: the front goes down
        ((quarter, 0, quarter), (0, 1, 0), (0, 0, 1)),  # yaw is outermost
    ):
        pose = kitti_raw.mercator_poses(np.array([[49.0, 8.4, 100.0, *angles]]))[0]
        np.testing.assert_allclose(pose[:3, :3] @ axis, expected, atol=1e-12)


def test_points_are_projected_to_where_calibration_files_say(root: Path) -> None:
    """The expected pixel is that of P_rect R_rect Tr_velo_to_cam Tr_imu_to_velo."""

    def entry(file: str, name: str) -> np.ndarray:
        lines = (root / "2011_09_26" / f"{file}.txt").read_text().splitlines()
        line = next(line for line in lines if line.startswith(f"{name}:"))
        return np.array(line.split()[1:], float)

    point_imu = np.array([12.0, 1.5, -0.5])  # ahead, a little to the left
    velo_from_imu = entry("calib_imu_to_velo", "R").reshape(3, 3)
    point_velo = velo_from_imu @ point_imu + entry("calib_imu_to_velo", "T")
    cam_from_velo = entry("calib_velo_to_cam", "R").reshape(3, 3)
    point_cam = cam_from_velo @ point_velo + entry("calib_velo_to_cam", "T")
    point_rect = entry("calib_cam_to_cam", "R_rect_00").reshape(3, 3) @ point_cam
    projection = entry("calib_cam_to_cam", "P_rect_02").reshape(3, 4)
    homogeneous = projection @ [*point_rect, 1.0]
    recording = raw(root).recordings[NAME]
    oxts = root / DRIVE / "oxts" / "data"
    readings = [np.loadtxt(oxts / f"{number:010d}.txt") for number in (0, 3)]
    world_from_imu = kitti_raw.mercator_poses(np.stack(readings))[1]
    point_world = world_from_imu @ [*point_imu, 1.0]
    point = se3.inverse(recording.trajectory.world_from_cam[3]) @ point_world
    pixel, _ = pinhole.project(point[:3], recording.intrinsics)
    assert recording.trajectory.is_metric
    np.testing.assert_allclose(pixel, homogeneous[:2] / homogeneous[2], atol=1e-6)


def test_times_have_nanoseconds_and_start_at_zero(tmp_path: Path) -> None:
    path = tmp_path / "timestamps.txt"
    path.write_text("2011-09-26 23:59:59.900000001\n2011-09-27 00:00:00\n2011-09-27 00:00:00.1\n")
    times_s = kitti_raw.read_timestamps(path, RAISE)
    np.testing.assert_allclose(times_s, [0, 0.099999999, 0.199999999], atol=1e-12)


def test_without_readings_there_are_no_poses(tmp_path: Path, write_kitti_raw: Write) -> None:
    write_kitti_raw(tmp_path, 7, street.clip(), with_poses=False)
    assert raw(tmp_path)[0].trajectory is None
    assert [finding.severity for finding in Doctor().examine(tmp_path).findings] == ["note"]


@pytest.mark.parametrize(
    ("file", "line", "text", "message"),
    [
        ("2011_09_26/calib_cam_to_cam.txt", 4, "S_rect_02: 1242 375", "S_rect_02 is 1242x375, the"),
        ("2011_09_26/calib_cam_to_cam.txt", 3, "R_rect: 1 0 0", "has no line 'R_rect_00:'"),
        ("2011_09_26/calib_velo_to_cam.txt", 2, "R: one", "line 2: 'one' is not a finite number"),
        (f"{DRIVE}/image_02/timestamps.txt", 3, "2011-09-31 13:02:25", "line 3: '2011-09-31 13:02"),
        (f"{DRIVE}/image_02/timestamps.txt", 3, "2011-09-26 13:02:25.0", "is not after"),
        (f"{DRIVE}/oxts/data/0000000003.txt", 1, "49 8 100", "line 1: 3 numbers, expected 30"),
        (f"{DRIVE}/oxts/data/0000000003.txt", 1, "95" + 29 * " 0", "line 1: latitude 95"),
    ],
)
def test_loader_and_doctor_report_damage_by_file_and_line(
    root: Path, edit: Edit, file: str, line: int, text: str, message: str
) -> None:
    edit(root / file, line, text)
    with pytest.raises(BadData) as caught:
        raw(root)
    assert str(caught.value).startswith(str(root / file))
    assert message in str(caught.value)
    examination = Doctor().examine(root)
    assert not examination.is_sound
    assert str(caught.value) in [str(finding) for finding in examination.findings]


def test_missing_files_are_named(root: Path) -> None:
    with pytest.raises(BadData, match="has no image_03: give a camera of"):
        raw(root, camera=3)
    (root / DRIVE / "oxts/data/0000000002.txt").unlink()
    with pytest.raises(BadData, match=r"0000000002\.txt: does not exist"):
        raw(root)
    with pytest.raises(BadData, match=r"holds no folder such as 2011_09_26"):
        raw(root / "2011_09_26")
