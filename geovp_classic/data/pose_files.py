"""Text files of numbers: trajectories in KITTI's format (12 or 13 numbers a line) or TUM's (8), and
times.

KITTI: the rows of world_from_cam[:3] one after the other, with or without the frame index in front.
TUM: `t x y z qx qy qz qw`, time in seconds, world_from_cam. Blank lines and comments (#) are
skipped. A `scan_` function adds a finding for every bad line and returns NaN in its place; a
`read_` function raises BadData for the first bad line.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic import files
from geovp_classic.data.atomic import atomic_write
from geovp_classic.data.findings import Findings
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, IntArray, Trajectory

MAX_NUMBER = 2.0**63  # times in nanoseconds are below it
ROTATION_TOLERANCE = (
    1e-3  # of R R' - I and of a quaternion's length, as text files round them
)

Scanned = TypeVar("Scanned")


def read_kitti(path: Path) -> tuple[IntArray | None, FloatArray]:
    """Read frame indices [N] and world_from_cam [N, 4, 4].

    Indices are None if the lines hold 12 numbers. BadData for a bad line.
    """
    keys, world_from_cam = _read(scan_kitti, path)
    return None if keys is None else keys.astype(np.int64), world_from_cam


def read_tum(path: Path, *, is_metric: bool = True) -> Trajectory:
    """Read a TUM file; the caller states whether its unit is the metre, the file does not."""
    times_s, world_from_cam = _read(scan_tum, path)
    return Trajectory(world_from_cam, times_s, is_metric)


def read_times(path: Path) -> FloatArray:
    """Read the times in seconds [N] of a file with one increasing number per line."""
    return _read(scan_times, path)


def _read(scan: Callable[[Path, Findings], Scanned], path: Path) -> Scanned:
    """Scan a file; BadData for the first error."""
    findings = Findings()
    scanned = scan(path, findings)
    findings.raise_first()
    return scanned


def has_times(path: Path) -> bool:
    """Return whether a trajectory file is TUM (True) or KITTI (False), by its first line."""
    _, first_line = _read(read_lines, path)[0]
    return len(first_line.split()) == 8


def read_trajectory(
    path: Path, times_s: FloatArray | None = None, *, is_metric: bool = True
) -> Trajectory:
    """Read a TUM file, or a KITTI file with the times of all frames, told apart by content.

    `times_s` is for KITTI files alone: their rows are frames 0, 1, ..., or those of the indices in
    front.
    """
    if has_times(path):
        return read_tum(path, is_metric=is_metric)
    indices, world_from_cam = read_kitti(path)
    if times_s is None:
        raise BadData(
            f"{path} is in KITTI's format, which has no times: give those of all frames"
        )
    if indices is None:
        if len(world_from_cam) != len(times_s):
            raise BadData(
                f"{path}: {len(world_from_cam)} poses for {len(times_s)} frames, expected one each"
            )
        return Trajectory(world_from_cam, times_s, is_metric)
    if indices[-1] >= len(times_s):
        raise BadData(
            f"{path}: a pose of frame {indices[-1]}, but frames end at {len(times_s) - 1}"
        )
    return Trajectory(world_from_cam, times_s[indices], is_metric)


def write_kitti(path: Path, trajectory: Trajectory) -> None:
    """Write one line of 12 numbers per pose, exact to the last bit, atomically."""
    _write_rows(path, trajectory.world_from_cam[:, :3].reshape(-1, 12))


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write one line `t x y z qx qy qz qw` per pose, exact to rounding, atomically."""
    world_from_cam = trajectory.world_from_cam
    quaternions = Rotation.from_matrix(world_from_cam[:, :3, :3]).as_quat()
    columns = [
        trajectory.times_s[:, None],
        world_from_cam[:, :3, 3],
        quaternions,
    ]
    _write_rows(path, np.hstack(columns), "# t_s x y z qx qy qz qw\n")


def scan_kitti(
    path: Path, findings: Findings
) -> tuple[FloatArray | None, FloatArray]:
    """Scan the frame indices [N], None if there are none, and world_from_cam [N, 4, 4] of a
    KITTI file.
    """
    return _scan_poses(path, (12, 13), _pose_of_matrix, findings)


def scan_tum(path: Path, findings: Findings) -> tuple[FloatArray, FloatArray]:
    """Scan the times in seconds [N] and world_from_cam [N, 4, 4] of a TUM file."""
    return _scan_poses(path, (8,), _pose_of_quaternion, findings)


def scan_asl(
    path: Path, start_ns: float, findings: Findings
) -> tuple[FloatArray, FloatArray]:
    """Scan the times [N] and world_from_body [N, 4, 4] of EuRoC's data.csv.

    Times are seconds after `start_ns`.
    """

    def pose_of(numbers: FloatArray) -> FloatArray:
        return _pose_of_quaternion(
            numbers[[0, 1, 2, 3, 5, 6, 7, 4]]
        )  # the real part comes first

    times_ns, world_from_body = _scan_poses(
        path, (17, 8), pose_of, findings, ","
    )
    return (times_ns - start_ns) / 1e9, world_from_body


def _scan_poses(
    path: Path,
    counts: tuple[int, ...],
    pose_of: Callable[
        [FloatArray], FloatArray
    ],  # [K] -> [4, 4]; BadData for a bad line
    findings: Findings,
    separator: str | None = None,
) -> tuple[Any, FloatArray]:
    """Scan the times or frame indices [N], None if there are none, and poses [N, 4, 4]."""
    lines, rows = _scan_rows(path, counts, findings, separator)
    poses = np.full((len(rows), 4, 4), np.nan)
    for number in np.flatnonzero(np.isfinite(rows[:, 0])):
        try:
            poses[number] = pose_of(rows[number])
        except BadData as problem:
            findings.error(path, str(problem), lines[number])
    return None if rows.shape[1] == 12 else rows[:, 0], poses


def _pose_of_matrix(numbers: FloatArray) -> FloatArray:
    """Convert the rows of a matrix [12], or a frame index and these [13], to a pose."""
    if len(numbers) == 13 and (numbers[0] < 0 or numbers[0] % 1):
        raise BadData(
            f"frame index {numbers[0]:g}, expected a whole number from 0"
        )
    matrix = numbers[-12:].reshape(3, 4)
    pose = se3.compose(matrix[:, :3], matrix[:, 3])
    return se3.orthonormalised(pose, ROTATION_TOLERANCE)


def _pose_of_quaternion(numbers: FloatArray) -> FloatArray:
    """Convert t, x, y, z, qx, qy, qz, qw to a pose."""
    length = np.linalg.norm(numbers[4:])
    if abs(length - 1) > ROTATION_TOLERANCE:
        raise BadData(f"the quaternion has length {length:.4g}, expected 1")
    rotation = Rotation.from_quat(numbers[4:]).as_matrix()
    return se3.compose(rotation, numbers[1:4])


def scan_times(path: Path, findings: Findings) -> FloatArray:
    """Scan the times in seconds [N] of a file with one increasing number per line."""
    return _scan_rows(path, (1,), findings)[1][:, 0]


def read_lines(path: Path, findings: Findings) -> list[tuple[int, str]]:
    """Read the numbers, from 1, and texts of the lines that hold more than a comment (#)."""
    try:
        text = files.read_text(path)
    except BadData as problem:
        if path.exists():
            findings.add(path, problem)
        else:
            findings.error(path, "does not exist")
        return []
    lines = []
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.partition("#")[0].strip()
        if line:
            lines.append((number, line))
    if not lines:
        findings.error(path, "is empty")
    return lines


def parse_numbers(
    path: Path,
    line: int,
    words: list[str],
    counts: tuple[int, ...],
    findings: Findings,
) -> FloatArray | None:
    """Return the finite numbers of a line, as many as one of `counts`.

    Return None with a finding for anything else.
    """
    try:
        numbers = np.array([_number(word) for word in words])
    except ValueError as problem:
        findings.error(path, str(problem), line)
        return None
    if len(numbers) in counts:
        return numbers
    expected = " or ".join(map(str, counts))
    findings.error(path, f"{len(numbers)} numbers, expected {expected}", line)
    return None


def _number(word: str) -> float:
    """Return a finite number; ValueError for any other word."""
    is_plain = word.isascii() and "_" not in word  # float takes 1_0 for 10
    number = float(word) if is_plain else np.nan
    if not abs(number) < MAX_NUMBER:
        raise ValueError(f"{word[:40]!r} is not a finite number")
    return number


def _scan_rows(
    path: Path,
    counts: tuple[int, ...],
    findings: Findings,
    separator: str | None = None,
) -> tuple[list[int], FloatArray]:
    """Return the numbers of N lines and what they hold [N, K], K being a count of the first.

    Rows of another length are reported, as are first columns that do not increase, unless they are
    of a rotation matrix (K = 12).
    """
    lines = read_lines(path, findings)
    count = len(lines[0][1].split(separator)) if lines else 0
    if count in counts:
        counts = (count,)
    rows = np.full((len(lines), counts[0]), np.nan)
    last = -np.inf
    for row, (line, text) in zip(rows, lines, strict=True):
        numbers = parse_numbers(
            path, line, text.split(separator), counts[:1], findings
        )
        if numbers is None:
            continue
        if len(numbers) != 12 and numbers[0] <= last:
            findings.error(
                path,
                f"{numbers[0]:.15g} is not after {last:.15g} before it",
                line,
            )
            continue
        row[:] = numbers
        last = numbers[0]
    return [line for line, _ in lines], rows


def _write_rows(path: Path, rows: FloatArray, header: str = "") -> None:
    """Write lines of numbers atomically; BadData if they cannot be written."""
    try:
        with atomic_write(path) as scratch:
            lines = [" ".join(map(repr, row)) + "\n" for row in rows.tolist()]
            scratch.write_text(header + "".join(lines), encoding="utf-8")
    except OSError as problem:
        raise BadData(
            f"{path} cannot be written ({problem.strerror}): give a file in a folder that can be "
            "written"
        ) from problem
