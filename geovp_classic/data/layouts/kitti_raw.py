"""Clips of KITTI raw's synchronised drives (Geiger et al. 2013).

A root holds `DATE/{calib_cam_to_cam,calib_imu_to_velo,calib_velo_to_cam}.txt` and drives
`DATE/DATE_drive_NNNN_sync/{image_0K,oxts}/{timestamps.txt, data/0000000000.*}`. A drive is called
by its folder's name without `_sync`. Its world is the local Mercator plane of its first reading: x
east, y north, z up.
"""

import contextlib
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.data.findings import Findings
from geovp_classic.data.formats import pose_files
from geovp_classic.data.formats.calibration_files import read_entry
from geovp_classic.data.frames.image_names import numbered_images
from geovp_classic.data.layouts import kitti
from geovp_classic.data.layouts.kitti import Kitti
from geovp_classic.data.recordings.scans import Scan, per_frame
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

EARTH_RADIUS_M = 6378137.0


@dataclass(frozen=True)
class KittiRaw(Kitti):
    """KITTI raw; settings as `Kitti`'s, sequences being drives such as "2011_09_26_drive_0084" or
    "...[100:200)".

    Poses come from the GPS and IMU readings of `oxts`; a drive without that folder has none. Times
    are seconds since the drive's first image.
    """

    name = "kitti-raw"
    prefix = "image_0"

    def folders(self) -> dict[str, Path]:
        """Return the drives of the root by name; BadData if it is not KITTI raw."""
        if not any(self.root.glob("[0-9][0-9][0-9][0-9]_[0-9][0-9]_[0-9][0-9]")):
            raise BadData(
                f"{self.root} holds no folder such as 2011_09_26: give the folder of KITTI raw's "
                "dates"
            )
        drives = sorted(self.root.glob("????_??_??/*_drive_*_sync/"))
        return {path.name.removesuffix("_sync"): path for path in drives}

    def scan(self, folder: Path, findings: Findings, camera: int | None = None) -> Scan:
        """Scan a drive with one of its cameras, by default the one that it shows.

        `folder` is root/DATE/DATE_drive_NNNN_sync; the calibration of the date lies next to it.
        """
        camera = self._cameras(folder)[0] if camera is None else camera
        images = numbered_images(folder / f"image_0{camera}" / "data", findings)
        calibration = folder.parent / "calib_cam_to_cam.txt"
        path = folder / f"image_0{camera}" / "timestamps.txt"
        times_s = per_frame(read_timestamps, path, images, findings)
        poses = None
        if (folder / "oxts").is_dir():
            poses = _read_poses(folder, len(images), findings)
        name = f"P_rect_0{camera}"
        scan = kitti.rectified(images, calibration, name, times_s, poses, findings)
        with findings.catch(calibration):
            size_px = read_entry(calibration, f"S_rect_0{camera}", 2)
            stored_px = scan.cameras[0].size_px if scan.cameras else size_px
            if (size_px != stored_px).any():
                raise BadData(
                    f"S_rect_0{camera} is {size_px[0]:g}x{size_px[1]:g}, the images are "
                    f"{stored_px[0]}x{stored_px[1]}: scale S_rect and P_rect as the images were"
                )
        return scan


def read_timestamps(path: Path, findings: Findings) -> FloatArray:
    """Read the times [N] in seconds since the first."""

    def parse_line(text: str) -> tuple[np.datetime64, None]:
        with contextlib.suppress(ValueError):
            if re.fullmatch(r"[\d-]+ [\d:.]+", text):
                return np.datetime64(text, "ns"), None
        raise BadData(f"{text!r} is not a time such as 2011-09-26 13:02:25.964389445")

    stamps, _ = findings.parse(path, parse_line, (np.datetime64("NaT"), None))
    times = np.array(stamps, "datetime64[ns]")
    return (times - times[:1]) / np.timedelta64(1, "s")


def _read_poses(folder: Path, num_frames: int, findings: Findings) -> FloatArray | None:
    """Read world_from_cam0 [N, 4, 4]; None with a finding.

    The calibration states velo_from_imu, cam_from_velo and the rotation of the rectification. A
    reading has 30 numbers: latitude, longitude (degrees), altitude (m), roll, pitch and yaw (rad)
    come first.
    """
    date = folder.parent
    readings = []
    for number in range(num_frames):
        path = folder / f"oxts/data/{number:010d}.txt"
        with findings.catch(path, line=1):
            reading = read_entry(path, "", 30)
            if abs(reading[0]) >= 90:
                raise BadData(f"latitude {reading[0]:g}, expected -90 to 90 degrees")
            readings.append(reading)
    with findings.catch(date):
        cam0_from_imu: FloatArray = np.eye(4)
        for name, turn in (
            ("imu_to_velo", "R"),
            ("velo_to_cam", "R"),
            ("cam_to_cam", "R_rect_00"),
        ):
            path = date / f"calib_{name}.txt"
            rotation = read_entry(path, turn, 9).reshape(3, 3)
            shift = read_entry(path, "T", 3) if turn == "R" else np.zeros(3)
            cam0_from_imu = se3.compose(rotation, shift) @ cam0_from_imu
        cam0_from_imu = se3.orthonormalised(cam0_from_imu, pose_files.ROTATION_TOLERANCE)
        if readings and len(readings) == num_frames:
            imu_from_cam0 = se3.inverse(cam0_from_imu)
            return mercator_poses(np.array(readings)) @ imu_from_cam0
    return None


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
