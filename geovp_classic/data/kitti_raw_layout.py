"""The files of KITTI raw's synchronised drives: where they lie, how GPS and IMU readings become
camera poses.

A root holds `DATE/{calib_cam_to_cam,calib_imu_to_velo,calib_velo_to_cam}.txt` and drives
`DATE/DATE_drive_NNNN_sync/{image_0K,oxts}/{timestamps.txt, data/0000000000.*}` (Geiger et al.
2013). A drive is called by its folder's name without `_sync`. Its world is the local Mercator plane
of its first reading: x east, y north, z up.
"""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.data import kitti_layout, pose_files
from geovp_classic.data.findings import Finding, error, raise_first
from geovp_classic.data.pose_files import PoseTable
from geovp_classic.data.windows import Recording
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import ByteArray, FloatArray, Trajectory

CAM_TO_CAM, IMU_TO_VELO, VELO_TO_CAM = (
    "calib_cam_to_cam.txt",
    "calib_imu_to_velo.txt",
    "calib_velo_to_cam.txt",
)
PREFIX, IMAGES = "image_0", "image_0{}/data"
EARTH_RADIUS_M = 6378137.0
NUM_READINGS = (
    30  # of a line of oxts; lat, lon (degrees), alt (m), roll, pitch, yaw (rad) come first
)
_DATE = re.compile(r"\d{4}_\d\d_\d\d")
_STAMP = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d(\.\d{1,9})?")


def is_raw(root: Path) -> bool:
    """Whether a folder is laid out as KITTI raw rather than as KITTI odometry."""
    return root.is_dir() and any(_DATE.fullmatch(path.name) for path in root.iterdir())


def sequence_names(root: Path) -> list[str]:
    """The drives of a root, sorted; BadData says what a root must look like."""
    if not is_raw(root):
        raise BadData(
            f"{root} holds no folder such as 2011_09_26: give the folder that holds KITTI raw's "
            "dates"
        )
    return sorted(
        path.name.removesuffix("_sync")
        for path in root.glob("????_??_??/*_drive_*_sync")
        if path.is_dir()
    )


def drive_folder(root: Path, name: str) -> Path:
    """The folder of a drive, beside which its date's calibration lies."""
    return root / name.partition("_drive_")[0] / f"{name}_sync"


def read_recording(
    root: Path,
    name: str,
    camera: int | None,  # None: the preferred one of those there
    load: Callable[[Path], ByteArray],
    camera_height_m: float | None,
    *,
    with_right: bool,
) -> Recording:
    """One drive seen by one camera, everything but the images read and checked; BadData names what
    is wrong.
    """
    if name not in (names := sequence_names(root)):
        raise BadData(
            f"drive {name!r} is not in {root}, which holds {', '.join(names) or 'none'} "
            "(folders *_sync)"
        )
    folder = drive_folder(root, name)
    calibration = folder.parent / CAM_TO_CAM
    camera = kitti_layout.choose_camera(folder, camera, PREFIX)
    left, left_from_cam0, right = kitti_layout.read_cameras(
        folder, camera, calibration, load, with_right=with_right, images=IMAGES
    )
    raise_first(
        scan_sizes(calibration, camera, (left.intrinsics.width_px, left.intrinsics.height_px))
    )
    path = folder / f"{PREFIX}{camera}" / "timestamps.txt"
    times_s, _, findings = scan_timestamps(path)
    raise_first(findings)
    if len(times_s) != len(left.frames):
        raise BadData(
            f"{path}: {len(times_s)} times for {len(left.frames)} frames, expected one each"
        )
    trajectory = None
    if (folder / "oxts").is_dir():
        table, findings = scan_poses(folder, len(left.frames))
        raise_first(findings)
        trajectory = Trajectory(
            table.world_from_cam @ se3.inverse(left_from_cam0), times_s, is_metric=True
        )
    return Recording(
        name, left.frames, times_s, left.intrinsics, trajectory, camera_height_m, right
    )


def scan_timestamps(path: Path) -> tuple[FloatArray, tuple[int, ...], list[Finding]]:
    """The good times [N] in seconds since the first, their line numbers, and the errors of the
    other lines.
    """
    lines, findings = pose_files.read_lines(path)
    stamps: dict[int, np.datetime64] = {}
    for number, text in lines:
        try:
            stamp = np.datetime64(text.replace(" ", "T"), "ns") if _STAMP.fullmatch(text) else None
        except ValueError:
            stamp = None
        if stamp is None:
            findings.append(
                error(path, number, f"{text!r} is not a time such as 2011-09-26 13:02:25.964389445")
            )
        elif stamps and stamp <= (before := next(reversed(stamps.items())))[1]:
            findings.append(
                error(path, number, f"time {text} is not after that of line {before[0]}")
            )
        else:
            stamps[number] = stamp
    whole_ns = np.array(list(stamps.values()), "datetime64[ns]").astype(np.int64)
    return (whole_ns - whole_ns[:1]) / 1e9, tuple(stamps), findings


def scan_sizes(calibration: Path, camera: int, size_px: tuple[int, int]) -> list[Finding]:
    """An error when images are not of the size that they were calibrated at."""
    numbers, findings = _entry(calibration, f"S_rect_0{camera}", 2)
    if numbers is not None and tuple(numbers) != size_px:
        message = (
            f"S_rect_0{camera} is {numbers[0]:g}x{numbers[1]:g}, the images are "
            f"{size_px[0]}x{size_px[1]}"
        )
        return [error(calibration, None, f"{message}: scale S_rect and P_rect as the images were")]
    return findings


def scan_poses(folder: Path, num_frames: int) -> tuple[PoseTable, list[Finding]]:
    """world_from_cam0 of the frames that have a good reading, `lines` being their numbers + 1, and
    all errors.
    """
    cam0_from_imu, findings = scan_cam0_from_imu(folder.parent)
    readings: dict[int, FloatArray] = {}
    for number in range(num_frames):
        path = folder / "oxts" / "data" / f"{number:010d}.txt"
        numbers, problem = _reading(path)
        if problem is not None:
            findings.append(problem)
        else:
            readings[number + 1] = numbers
    if not readings or cam0_from_imu is None:
        return PoseTable((), None, np.zeros((0, 4, 4))), findings
    world_from_imu = mercator_poses(np.stack(list(readings.values())))
    return PoseTable(tuple(readings), None, world_from_imu @ se3.inverse(cam0_from_imu)), findings


def mercator_poses(
    # [N, 6]: latitude and longitude in degrees, altitude in metres, roll, pitch, yaw in radians
    readings: FloatArray,
) -> FloatArray:
    """world_from_imu [N, 4, 4], the IMU's axes being forward, left, up; yaw is 0 towards east, and
    grows to the left.

    The Mercator projection with the scale of the first latitude, and R = Rz(yaw) Ry(pitch)
    Rx(roll), as the development kit of KITTI raw documents them; the origin is the first position.
    """
    latitude_rad, longitude_rad = np.radians(readings[:, 0]), np.radians(readings[:, 1])
    scale_m = EARTH_RADIUS_M * np.cos(latitude_rad[0])
    north_m = scale_m * np.log(np.tan(np.pi / 4 + latitude_rad / 2))
    position = np.stack([scale_m * longitude_rad, north_m, readings[:, 2]], axis=-1)
    rotation = Rotation.from_euler("ZYX", readings[:, [5, 4, 3]]).as_matrix()
    return se3.compose(rotation, position - position[0])


def scan_cam0_from_imu(date: Path) -> tuple[FloatArray | None, list[Finding]]:
    """The rectified camera 0 from the IMU [4, 4] by a date's calibration; None, and why, where it
    is incomplete.
    """
    links = [(CAM_TO_CAM, "R_rect_00", ""), (VELO_TO_CAM, "R", "T"), (IMU_TO_VELO, "R", "T")]
    scanned = [
        _transform(date / file, rotation, translation) for file, rotation, translation in links
    ]
    findings = [finding for _, problems in scanned for finding in problems]
    rect_from_cam, cam_from_velo, velo_from_imu = (link for link, _ in scanned)
    if rect_from_cam is None or cam_from_velo is None or velo_from_imu is None:
        return None, findings
    return rect_from_cam @ cam_from_velo @ velo_from_imu, findings


def _transform(
    path: Path, rotation: str, translation: str
) -> tuple[FloatArray | None, list[Finding]]:
    """The rigid transform [4, 4] of two lines of a calibration file, of one where there is no
    translation.
    """
    turned, findings = _entry(path, rotation, 9)
    moved, problems = _entry(path, translation, 3) if translation else (np.zeros(3), [])
    if turned is None or moved is None:
        return None, list(dict.fromkeys([*findings, *problems]))
    try:
        return se3.orthonormalised(
            se3.compose(turned.reshape(3, 3), moved), pose_files.ROTATION_TOLERANCE
        ), []
    except BadData as problem:
        return None, [error(path, None, f"{rotation}: {problem}")]


def _entry(path: Path, name: str, count: int) -> tuple[FloatArray | None, list[Finding]]:
    """The numbers of the line `name: ...`; None, and why, where it is missing or wrong."""
    lines, findings = pose_files.read_lines(path)
    for number, text in lines:
        if text.startswith(f"{name}:"):
            row = pose_files.parse_row(path, number, text.partition(":")[2])
            if isinstance(row, Finding):
                return None, [row]
            if len(row.numbers) != count:
                return None, [
                    error(path, number, f"{name} has {len(row.numbers)} numbers, expected {count}")
                ]
            return np.array(row.numbers), []
    return None, findings or [error(path, None, f"has no line '{name}:'")]


def _reading(path: Path) -> tuple[FloatArray, Finding | None]:
    """Latitude, longitude, altitude, roll, pitch and yaw [6] of a file of oxts, or what is wrong
    with it.
    """
    lines, findings = pose_files.read_lines(path)
    nothing = np.zeros(6)
    if not lines:
        return nothing, findings[0] if findings else error(path, None, "holds no reading")
    row = pose_files.parse_row(path, *lines[0])
    if isinstance(row, Finding):
        return nothing, row
    if len(row.numbers) != NUM_READINGS:
        return nothing, error(
            path, row.line, f"{len(row.numbers)} numbers, expected {NUM_READINGS}, latitude first"
        )
    if abs(row.numbers[0]) >= 90:
        return nothing, error(
            path, row.line, f"latitude {row.numbers[0]:g}, expected degrees between -90 and 90"
        )
    return np.array(row.numbers[:6]), None
