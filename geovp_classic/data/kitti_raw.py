"""Clips of KITTI raw's synchronised drives (Geiger et al. 2013).

A root holds `DATE/{calib_cam_to_cam,calib_imu_to_velo,calib_velo_to_cam}.txt` and drives
`DATE/DATE_drive_NNNN_sync/{image_0K,oxts}/{timestamps.txt, data/0000000000.*}`. A drive is called
by its folder's name without `_sync`. Its world is the local Mercator plane of its first reading: x
east, y north, z up.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.data import kitti, pose_files
from geovp_classic.data.findings import Findings
from geovp_classic.data.frames import scan_numbered
from geovp_classic.data.kitti import Kitti
from geovp_classic.data.scan import Scan
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

EARTH_RADIUS_M = 6378137.0
NUM_READINGS = 30  # of oxts; lat, lon (degrees), alt (m), roll, pitch, yaw (rad) come first


@dataclass(frozen=True)
class KittiRaw(Kitti):
    """KITTI raw; settings as `Kitti`'s, sequences being drives such as "2011_09_26_drive_0084" or
    "...[100:200)".

    Poses come from the GPS and IMU readings of `oxts`; a drive without that folder has none. Times
    are seconds since the drive's first image.
    """

    name: ClassVar[str] = "kitti-raw"
    prefix: ClassVar[str] = "image_0"

    @staticmethod
    def folders(root: Path) -> dict[str, Path]:
        """Return the drives of a root by name; BadData if it is not KITTI raw."""
        if not any(root.glob("[0-9][0-9][0-9][0-9]_[0-9][0-9]_[0-9][0-9]")):
            raise BadData(
                f"{root} holds no folder such as 2011_09_26: give the folder of KITTI raw's dates"
            )
        drives = sorted(root.glob("????_??_??/*_drive_*_sync"))
        return {
            path.name.removesuffix("_sync"): path
            for path in drives
            if path.is_dir()
        }

    @staticmethod
    def scan(folder: Path, camera: int) -> Scan:
        """Scan a drive with one of its cameras.

        `folder` is root/DATE/DATE_drive_NNNN_sync; the calibration of the date lies beside it.
        """
        findings = Findings()
        images = scan_numbered(folder / f"image_0{camera}" / "data", findings)
        calibration = folder.parent / "calib_cam_to_cam.txt"
        projection = kitti.scan_projection(
            calibration, f"P_rect_0{camera}", findings
        )
        path = folder / f"image_0{camera}" / "timestamps.txt"
        times_s = scan_timestamps(path, findings)
        times_s = kitti.one_per_frame(path, times_s, len(images), findings)
        world_from_cam0 = None
        if (folder / "oxts").is_dir():
            world_from_cam0 = _scan_poses(folder, len(images), findings)
        result = kitti.rectified(
            images, times_s, projection, world_from_cam0, findings
        )
        size_px = kitti.scan_entry(
            calibration, f"S_rect_0{camera}", 2, findings
        )
        if (
            size_px is not None
            and result.cameras
            and result.cameras[0].size_px != tuple(size_px)
        ):
            width_px, height_px = result.cameras[0].size_px
            message = (
                f"S_rect_0{camera} is {size_px[0]:g}x{size_px[1]:g}, the images are "
                f"{width_px}x{height_px}: scale S_rect and P_rect as the images were"
            )
            findings.error(calibration, message)
        return result


def scan_timestamps(path: Path, findings: Findings) -> FloatArray:
    """Scan the times [N] in seconds since the first."""
    lines = pose_files.read_lines(path, findings)
    stamps = np.full(len(lines), "NaT", "datetime64[ns]")
    for number, (line, text) in enumerate(lines):
        is_time = re.fullmatch(r"[\d-]+ [\d:.]+", text)
        try:
            stamps[number] = text.replace(" ", "T") if is_time else "NaT"
        except ValueError:
            is_time = None
        if not is_time:
            message = (
                f"{text!r} is not a time such as 2011-09-26 13:02:25.964389445"
            )
            findings.error(path, message, line)
        elif number and stamps[number] <= stamps[number - 1]:
            findings.error(
                path, f"time {text} is not after the one before", line
            )
    return (stamps - stamps[:1]) / np.timedelta64(1, "s")


def _scan_poses(
    folder: Path, num_frames: int, findings: Findings
) -> FloatArray | None:
    """Scan world_from_cam0 [N, 4, 4], NaN for frames without a good reading."""
    cam0_from_imu = _scan_cam0_from_imu(folder.parent, findings)
    readings = np.full((num_frames, NUM_READINGS), np.nan)
    for number in range(num_frames):
        path = folder / "oxts" / "data" / f"{number:010d}.txt"
        for line, text in pose_files.read_lines(path, findings)[:1]:
            words = text.split()
            numbers = pose_files.parse_numbers(
                path, line, words, (NUM_READINGS,), findings
            )
            if numbers is None:
                continue
            readings[number] = numbers
            if abs(numbers[0]) >= 90:
                findings.error(
                    path,
                    f"latitude {numbers[0]:g}, expected -90 to 90 degrees",
                    line,
                )
    good = np.isfinite(readings[:, 0])
    if cam0_from_imu is None or not good.any():
        return None
    world_from_cam0 = np.full((num_frames, 4, 4), np.nan)
    world_from_cam0[good] = mercator_poses(readings[good]) @ se3.inverse(
        cam0_from_imu
    )
    return world_from_cam0


def mercator_poses(
    # [N, 6 or more]: latitude and longitude in degrees, altitude in metres, roll, pitch, yaw in
    # radians
    readings: FloatArray,
) -> FloatArray:
    """Return world_from_imu [N, 4, 4], the IMU's axes being forward, left, up.

    Yaw is 0 towards east, and grows to the left. The Mercator projection has the scale of the first
    latitude, and R = Rz(yaw) Ry(pitch) Rx(roll), as the development kit of KITTI raw documents
    them; the origin is the first position.
    """
    latitude_rad = np.radians(readings[:, 0])
    longitude_rad = np.radians(readings[:, 1])
    scale_m = EARTH_RADIUS_M * np.cos(latitude_rad[0])
    east_m = scale_m * longitude_rad
    north_m = scale_m * np.log(np.tan(np.pi / 4 + latitude_rad / 2))
    position = np.stack([east_m, north_m, readings[:, 2]], axis=-1)
    rotation = Rotation.from_euler("ZYX", readings[:, [5, 4, 3]]).as_matrix()
    return se3.compose(rotation, position - position[0])


def _scan_cam0_from_imu(date: Path, findings: Findings) -> FloatArray | None:
    """Scan cam0_from_imu [4, 4] of a date, camera 0 being the rectified one.

    The calibration states velo_from_imu, cam_from_velo and the rotation of the rectification.
    """
    cam0_from_imu = np.eye(4)
    for file in ("calib_imu_to_velo.txt", "calib_velo_to_cam.txt"):
        rotation = kitti.scan_entry(date / file, "R", 9, findings)
        translation = kitti.scan_entry(date / file, "T", 3, findings)
        if rotation is None or translation is None:
            return None
        cam0_from_imu = (
            se3.compose(rotation.reshape(3, 3), translation) @ cam0_from_imu
        )
    rectification = kitti.scan_entry(
        date / "calib_cam_to_cam.txt", "R_rect_00", 9, findings
    )
    if rectification is None:
        return None
    rect_from_cam = se3.compose(rectification.reshape(3, 3), np.zeros(3))
    try:
        return se3.orthonormalised(
            rect_from_cam @ cam0_from_imu, pose_files.ROTATION_TOLERANCE
        )
    except BadData as problem:
        findings.error(
            date, f"the calibration's rotations are invalid: {problem}"
        )
        return None
