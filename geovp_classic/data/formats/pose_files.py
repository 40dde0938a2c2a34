"""Trajectories in KITTI's format (12 or 13 numbers a line) or TUM's (8), and files of times.

KITTI: the rows of world_from_cam[:3] one after the other, with or without the frame index in front.
TUM: `t x y z qx qy qz qw`, time in seconds, world_from_cam. Blank lines, comments (#) and a header
are skipped. Functions raise BadData for the first bad line, or add a finding for each bad line to
the `findings` that they are given and return NaN in its place.
"""

import itertools
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic import files
from geovp_classic.atomic import atomic_write
from geovp_classic.data.findings import RAISE, Findings, parse_numbers, words
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory

# of R R' - I and of a quaternion's length, as text files round them
ROTATION_TOLERANCE = 1e-3


def read_kitti(path: Path, findings: Findings = RAISE) -> FloatArray:
    """Read world_from_cam [N, 4, 4] of frames 0, 1, ..., N - 1."""
    return _read(path, (12, 13), _pose_of_matrix, findings)[1]


def read_tum(path: Path, findings: Findings = RAISE) -> tuple[FloatArray, FloatArray]:
    """Read times in seconds [N] and world_from_cam [N, 4, 4].

    The real part of quaternions comes first if the first line says so, as in the ASL layout.
    """
    header = files.read_text(path).partition("\n")[0] if path.is_file() else ""
    axes = "".join(re.findall(r"[wxyz]\b", header))
    pose_of = _pose_of_real_first if axes.startswith("xyzw") else pose_of_quaternion
    return _read(path, (8,), pose_of, findings)


def read_asl(path: Path, findings: Findings = RAISE) -> tuple[FloatArray, FloatArray]:
    """Read times in seconds [N] and world_from_body [N, 4, 4] of a data.csv, which has ns."""
    times_ns, world_from_body = _read(path, (17, 8), _pose_of_real_first, findings)
    return times_ns / 1e9, world_from_body


def read_times(path: Path, findings: Findings = RAISE) -> FloatArray:
    """Read the times in seconds [N] of a file with one increasing number per line."""

    def parse_line(text: str) -> tuple[float, None]:
        return parse_numbers(text, 1)[0], None

    times_s = np.array(findings.parse(path, parse_line, (np.nan, None))[0], np.float64)
    findings.check_steps(path, times_s)
    return times_s


def has_times(path: Path) -> bool:
    """Return whether a trajectory file is TUM (True) or KITTI (False), by its first line."""
    _, first_line = RAISE.lines(path)[0]
    return len(words(first_line)) == 8


def in_seconds(times: FloatArray) -> FloatArray:
    """Convert times that are nanoseconds since 1970 by their size, as ORB-SLAM3 writes them."""
    return times / 1e9 if len(times) and times[0] > 1e17 else times


def clock_of(times_s: FloatArray) -> str:
    """Return the name of the clock of times in seconds, by their size."""
    return "Unix time" if len(times_s) and times_s[0] > 1e8 else "time since the start"


def read_trajectory(
    path: Path, times_s: FloatArray | None = None, *, is_metric: bool = True
) -> Trajectory:
    """Read a TUM file, or a KITTI file with the times of all frames, told apart by content.

    `times_s` is for KITTI files alone: their rows are frames 0, 1, ..., or those of the indices in
    front. Times in nanoseconds become seconds. The caller states whether the unit is the metre,
    the file does not.
    """
    num_frames = None if times_s is None else len(times_s)
    if has_times(path):
        times, world_from_cam = read_tum(path)
        times_s = in_seconds(times)
        RAISE.check_steps(path, times_s)
    else:
        world_from_cam = read_kitti(path)
    if times_s is None:
        raise BadData(f"{path} is in KITTI's format, which has no times: give those of all frames")
    count = len(world_from_cam)
    if num_frames not in (None, count):
        raise BadData(f"{path}: {count} poses for {num_frames} frames, expected one each")
    return Trajectory(world_from_cam, times_s, is_metric)


def write_kitti(path: Path, trajectory: Trajectory) -> None:
    """Write one line of 12 numbers per pose, exact to the last bit, atomically."""
    _write(path, trajectory.world_from_cam[:, :3].reshape(-1, 12))


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write one line `t x y z qx qy qz qw` per pose, exact to rounding, atomically."""
    world_from_cam = trajectory.world_from_cam
    quaternions = Rotation.from_matrix(world_from_cam[:, :3, :3]).as_quat()
    rows = np.column_stack([trajectory.times_s, world_from_cam[:, :3, 3], quaternions])
    _write(path, rows, "t_s x y z qx qy qz qw")


def write_both(folder: Path, stem: str, trajectory: Trajectory) -> list[Path]:
    """Write STEM.kitti.txt and STEM.tum.txt; return the files."""
    kitti, tum = folder / f"{stem}.kitti.txt", folder / f"{stem}.tum.txt"
    write_kitti(kitti, trajectory)
    write_tum(tum, trajectory)
    return [kitti, tum]


def _read(
    path: Path,
    counts: tuple[int, ...],
    pose_of: Callable[[FloatArray], FloatArray],  # [K] -> [4, 4]; BadData for a bad line
    findings: Findings,
) -> tuple[FloatArray, FloatArray]:
    """Read times or frame indices [N], NaN if there are none, and poses [N, 4, 4].

    The first line tells which of `counts` all lines must hold.
    """
    expected = counts
    numbers_of_frames = itertools.count()

    def parse_line(text: str) -> tuple[float, FloatArray]:
        nonlocal expected
        frame = next(numbers_of_frames)
        numbers = parse_numbers(text, *expected)
        expected = (len(numbers),)
        if len(numbers) == 13 and numbers[0] != frame:
            raise BadData(f"frame index {numbers[0]:g}, expected {frame}")
        return frame if len(numbers) == 12 else numbers[0], pose_of(numbers)

    missing = np.nan, np.full((4, 4), np.nan)
    keys, poses = findings.parse(path, parse_line, missing)
    return np.array(keys, np.float64), np.reshape(poses, (-1, 4, 4))


def _pose_of_matrix(numbers: FloatArray) -> FloatArray:
    """Convert the rows of a matrix, which may follow a frame index [12 or 13], to a pose."""
    matrix = numbers[-12:].reshape(3, 4)
    pose = se3.compose(matrix[:, :3], matrix[:, 3])
    return se3.orthonormalised(pose, ROTATION_TOLERANCE)


def _pose_of_real_first(numbers: FloatArray) -> FloatArray:
    """Convert t, x, y, z, qw, qx, qy, qz, and numbers after them, to a pose."""
    return pose_of_quaternion(np.r_[numbers[:4], numbers[5:8], numbers[4]])


def pose_of_quaternion(numbers: FloatArray) -> FloatArray:
    """Convert t, x, y, z, qx, qy, qz, qw to a pose."""
    length = np.linalg.norm(numbers[4:])
    if not abs(length - 1) <= ROTATION_TOLERANCE:  # NaN, too
        raise BadData(f"the quaternion has length {length:.4g}, expected 1")
    return se3.compose(Rotation.from_quat(numbers[4:]).as_matrix(), numbers[1:4])


def _write(path: Path, rows: FloatArray, header: str = "") -> None:
    """Write lines of numbers atomically; BadData if they cannot be written."""
    advice = "give a file in a folder that can be written"
    with (
        files.checked(f"{path} cannot be written", advice),
        atomic_write(path) as scratch,
    ):
        np.savetxt(scratch, rows, fmt="%.17g", header=header)
