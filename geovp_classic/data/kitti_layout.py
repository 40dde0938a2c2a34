"""The files of KITTI odometry: where they lie, how cameras are numbered, what calib.txt says about
them (Geiger 2012).

A root holds `sequences/NN/{image_K/000000.png, calib.txt, times.txt}` and `poses/NN.txt`; any image
type, any name NN. P_k of calib.txt is K_k [I | t] with cam_k_from_cam0 = (I, t): all cameras are
rectified to look the same way, and poses are camera 0's, so world_from_camk = world_from_cam0 @
cam0_from_camk.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geovp_classic.data import pose_files
from geovp_classic.data.findings import Finding, error, raise_first
from geovp_classic.data.frames import FrameFiles, scan_numbered
from geovp_classic.data.windows import Recording, SideCamera
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Trajectory

PREFERRED_CAMERAS = (2, 0, 1, 3)  # left colour, left grey, then whatever is there
RIGHT_OF = {0: 1, 2: 3}
NO_IMAGES = "holds no images: expected a folder image_0, image_1, image_2 or image_3"
_PROJECTION = re.compile(
    r"P(?:_rect_0)?([0-3]):"
)  # in calib.txt, or in calib_cam_to_cam.txt of KITTI raw


@dataclass(frozen=True)
class Projection:
    """One line of calib.txt."""

    line: int
    matrix: FloatArray  # [3, 4]

    @property
    def cam_from_cam0(self) -> FloatArray:
        """The transform [4, 4] that the fourth column gives: t = K^-1 p4."""
        return se3.compose(np.eye(3), np.linalg.solve(self.matrix[:, :3], self.matrix[:, 3]))

    def intrinsics(self, width_px: int, height_px: int) -> Intrinsics:
        """The camera of images of that size."""
        k = self.matrix
        return Intrinsics(
            float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]), width_px, height_px
        )


def sequence_names(root: Path) -> list[str]:
    """The sequences of a root, sorted; BadData says what a root must look like."""
    folder = root / "sequences"
    if not root.is_dir():
        raise BadData(
            f"{root} does not exist: give the folder that holds KITTI's 'sequences' and 'poses'"
        )
    if not folder.is_dir():
        inside = root / "dataset"
        hint = (
            f"did you mean {inside}?"
            if (inside / "sequences").is_dir()
            else "give KITTI odometry's folder"
        )
        raise BadData(f"{root} holds no folder 'sequences': {hint}")
    return sorted(
        path.name for path in folder.iterdir() if path.is_dir() and not path.name.startswith(".")
    )


def cameras(folder: Path, prefix: str = "image_") -> list[int]:
    """The cameras of a sequence that have a folder image_K."""
    matches = [
        re.fullmatch(rf"{prefix}([0-3])", path.name) for path in folder.iterdir() if path.is_dir()
    ]
    return sorted(int(match[1]) for match in matches if match)


def scan_calibration(path: Path) -> tuple[dict[int, Projection], list[Finding]]:
    """The projections P0 to P3 by camera, and the errors of the other P lines; lines of other names
    are skipped.
    """
    lines, findings = pose_files.read_lines(path)
    projections = {}
    for number, text in lines:
        match = _PROJECTION.match(text)
        if match is None:
            continue
        row = pose_files.parse_row(path, number, text[match.end() :])
        if isinstance(row, Finding):
            findings.append(row)
        elif problem := _projection_problem(row.numbers):
            findings.append(error(path, number, f"{match[0]} {problem}"))
        else:
            projections[int(match[1])] = Projection(number, np.array(row.numbers).reshape(3, 4))
    return projections, findings


def missing_projection(path: Path, camera: int) -> Finding:
    """The finding for a camera that has images but no line in calib.txt."""
    return error(path, None, f"has no line 'P{camera}:' for the images of image_{camera}")


def pose_count_problem(
    indices: FloatArray | pose_files.IndexArray | None, num_poses: int, num_frames: int
) -> str:
    """Why poses (with frame indices where the file has them) are not one for each frame; empty when
    they are.
    """
    if indices is not None and num_poses:
        lacking = np.setdiff1d(np.arange(num_frames), indices)
        if len(lacking):
            return (
                f"no pose of frame {lacking[0]} ({len(lacking)} of {num_frames} frames have none)"
            )
    return (
        ""
        if num_poses == num_frames
        else f"{num_poses} poses for {num_frames} frames, expected one each"
    )


def read_recording(
    root: Path,
    name: str,
    camera: int | None,  # None: the preferred one of those there
    load: Callable[[Path], ByteArray],
    camera_height_m: float | None,
    *,
    with_right: bool,
) -> Recording:
    """One sequence seen by one camera, everything but the images read and checked; BadData names
    what is wrong.
    """
    names, folder = sequence_names(root), root / "sequences" / name
    if name not in names:
        raise BadData(
            f"sequence {name!r} is not in {folder.parent}, which holds "
            f"{', '.join(names) or 'nothing'}"
        )
    left, left_from_cam0, right = read_cameras(
        folder, camera, folder / "calib.txt", load, with_right=with_right
    )
    times_path, num_frames = folder / "times.txt", len(left.frames)
    times_s = pose_files.read_times(times_path)
    if len(times_s) != num_frames:
        raise BadData(
            f"{times_path}: {len(times_s)} times for {num_frames} frames, expected one each"
        )
    trajectory = _read_trajectory(root / "poses" / f"{name}.txt", times_s, left_from_cam0)
    return Recording(
        name, left.frames, times_s, left.intrinsics, trajectory, camera_height_m, right
    )


def _read_trajectory(
    path: Path, times_s: FloatArray, cam_from_cam0: FloatArray
) -> Trajectory | None:
    """The poses of a camera, one for each time, from the file of camera 0's; None
    without a file.
    """
    if not path.exists():
        return None
    indices, world_from_cam0 = pose_files.read_kitti(path)
    if problem := pose_count_problem(indices, len(world_from_cam0), len(times_s)):
        raise BadData(f"{path}: {problem}")
    return Trajectory(world_from_cam0 @ se3.inverse(cam_from_cam0), times_s, is_metric=True)


def read_cameras(
    folder: Path,
    camera: int | None,
    calibration: Path,
    load: Callable[[Path], ByteArray],
    *,
    with_right: bool,
    images: str = "image_{}",  # the folder of a camera's images
) -> tuple[SideCamera, FloatArray, SideCamera | None]:
    """The chosen camera, its cam_from_cam0, and the camera to the right of it where there is one
    and it is wanted.
    """
    prefix = images.partition("{}")[0]
    camera = choose_camera(folder, camera, prefix)
    projections, findings = scan_calibration(calibration)
    raise_first(findings)
    sides = [camera, RIGHT_OF.get(camera)] if with_right else [camera]
    read = {}
    for number in (number for number in sides if number in cameras(folder, prefix)):
        if number not in projections:
            raise_first([missing_projection(calibration, number)])
        read[number] = _side(folder / images.format(number), projections[number], load)
    (left, left_from_cam0), *others = read.values()
    right = None
    for side, right_from_cam0 in others:
        right = SideCamera(
            side.frames, side.intrinsics, right_from_cam0 @ se3.inverse(left_from_cam0)
        )
    return left, left_from_cam0, right


def choose_camera(folder: Path, camera: int | None, prefix: str = "image_") -> int:
    """The wanted camera, or the preferred one; BadData where there is none."""
    present = cameras(folder, prefix)
    if not present:
        raise BadData(f"{folder} {NO_IMAGES}")
    if camera is None:
        return next(preferred for preferred in PREFERRED_CAMERAS if preferred in present)
    if camera not in present:
        raise BadData(
            f"{folder} has no {prefix}{camera}: it has "
            f"{', '.join(f'{prefix}{number}' for number in present)}"
        )
    return camera


def _side(
    images: Path, projection: Projection, load: Callable[[Path], ByteArray]
) -> tuple[SideCamera, FloatArray]:
    """One camera with view_from_cam the identity, and its cam_from_cam0."""
    paths, findings = scan_numbered(images)
    raise_first(findings)
    height_px, width_px = load(paths[0]).shape[:2]
    frames = FrameFiles(paths, (width_px, height_px), load)
    return SideCamera(
        frames, projection.intrinsics(width_px, height_px), np.eye(4)
    ), projection.cam_from_cam0


def _projection_problem(numbers: tuple[float, ...]) -> str:
    if len(numbers) != 12:
        return f"has {len(numbers)} numbers, expected 12"
    matrix = np.array(numbers).reshape(3, 4)
    if not np.allclose(matrix[2, :3], [0, 0, 1]) or not np.allclose(
        [matrix[0, 1], matrix[1, 0]], 0
    ):
        return (
            "is not K [I | t] of a rectified camera: expected zeros beside the focal lengths "
            "and 0 0 1 below"
        )
    return "" if min(matrix[0, 0], matrix[1, 1]) > 0 else "has a focal length that is not positive"
