"""Text files of numbers: trajectories in KITTI's format (12 or 13 numbers a line) or TUM's (8), and
times.

KITTI: the rows of world_from_cam[:3] one after the other, with or without the frame index in front.
TUM: `t x y z qx qy qz qw`, time in seconds, world_from_cam. Blank lines and comments (#) are
skipped. A `scan_` function adds a finding for every bad line and returns NaN in its place; a
`read_` function raises BadData for the first bad line.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from geovp_classic import files
from geovp_classic.data.atomic import atomic_write
from geovp_classic.data.findings import Findings
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory

MAX_NUMBER = 2.0**63  # times in nanoseconds are below it
ROTATION_TOLERANCE = 1e-3  # of R R' - I and of a quaternion's length, as text files round them
IndexArray = npt.NDArray[np.int64]
Lines = list[tuple[int, str]]  # number, from 1, and text
Scanned = TypeVar("Scanned")


def read_kitti(path: Path) -> tuple[IndexArray | None, FloatArray]:
    """Read frame indices [N] (None if the lines hold 12 numbers) and world_from_cam [N, 4, 4]."""
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
    findings = Findings()
    lines = read_lines(path, findings)
    findings.raise_first()
    number, text = lines[0]
    count = len(text.split())
    if count not in (8, 12, 13):
        findings.error(path, f"{count} numbers, expected 8 (TUM), 12 or 13 (KITTI)", number)
        findings.raise_first()
    return count == 8


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
        raise BadData(f"{path} is in KITTI's format, which has no times: give those of all frames")
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
    columns = [trajectory.times_s[:, None], world_from_cam[:, :3, 3], quaternions]
    _write_rows(path, np.hstack(columns), "# t_s x y z qx qy qz qw\n")


def scan_kitti(path: Path, findings: Findings) -> tuple[FloatArray | None, FloatArray]:
    """Scan the frame indices [N] of a KITTI file, if it has them, and world_from_cam [N, 4, 4]."""
    lines, numbers = _scan_rows(path, (12, 13), findings)
    keys = None
    if numbers.shape[1] == 13:
        keys = numbers[:, 0]
        numbers = numbers[:, 1:]
        for number in np.flatnonzero((keys < 0) | (keys % 1 > 0)):
            message = f"frame index {keys[number]:g}, expected a whole number from 0"
            findings.error(path, message, lines[number])
    entries = numbers.reshape(-1, 3, 4)
    world_from_cam = se3.compose(entries[:, :, :3], entries[:, :, 3])
    for number in np.flatnonzero(np.isfinite(numbers[:, 0])):
        try:
            pose = se3.orthonormalised(world_from_cam[number], ROTATION_TOLERANCE)
        except BadData as problem:
            findings.error(path, str(problem), lines[number])
            pose = np.full((4, 4), np.nan)
        world_from_cam[number] = pose
    return keys, world_from_cam


def scan_tum(path: Path, findings: Findings) -> tuple[FloatArray, FloatArray]:
    """Scan the times in seconds [N] and world_from_cam [N, 4, 4] of a TUM file."""
    lines, numbers = _scan_rows(path, (8,), findings)
    return _from_quaternions(path, lines, numbers, findings)


def scan_asl(path: Path, start_ns: float, findings: Findings) -> tuple[FloatArray, FloatArray]:
    """Scan the times [N], in seconds after a start, and world_from_body of EuRoC's data.csv."""
    lines, numbers = _scan_rows(path, (17, 8), findings, separator=",")
    numbers = numbers[:, [0, 1, 2, 3, 5, 6, 7, 4]]  # from t, x, y, z, qw, qx, qy, qz, ...
    numbers[:, 0] = (numbers[:, 0] - start_ns) / 1e9
    return _from_quaternions(path, lines, numbers, findings)


def _from_quaternions(
    path: Path,
    lines: list[int],  # N
    numbers: FloatArray,  # [N, 8]: t, x, y, z, qx, qy, qz, qw
    findings: Findings,
) -> tuple[FloatArray, FloatArray]:
    length = np.linalg.norm(numbers[:, 4:], axis=1)
    for number in np.flatnonzero(np.abs(length - 1) > ROTATION_TOLERANCE):
        message = f"the quaternion has length {length[number]:.4g}, expected 1"
        findings.error(path, message, lines[number])
        numbers[number] = np.nan
    world_from_cam = np.full((len(lines), 4, 4), np.nan)
    good = np.isfinite(numbers[:, 0])
    if good.any():
        rotation = Rotation.from_quat(numbers[good, 4:]).as_matrix()
        world_from_cam[good] = se3.compose(rotation, numbers[good, 1:4])
    return numbers[:, 0], world_from_cam


def scan_times(path: Path, findings: Findings) -> FloatArray:
    """Scan the times in seconds [N] of a file with one increasing number per line."""
    return _scan_rows(path, (1,), findings)[1][:, 0]


def read_lines(path: Path, findings: Findings) -> Lines:
    """Read every line that is not empty once comments (#) are removed."""
    try:
        text = files.read_text(path)
    except BadData as problem:
        if path.exists():
            findings.add(path, problem)
        else:
            findings.error(path, "does not exist")
        return []
    lines: Lines = []
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.partition("#")[0].strip()
        if line:
            lines.append((number, line))
    if not lines:
        findings.error(path, "is empty")
    return lines


def parse_numbers(
    path: Path, line: int, words: list[str], counts: tuple[int, ...], findings: Findings
) -> FloatArray | None:
    """Return one of `counts` finite numbers of a line; None with a finding for anything else."""
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
    is_plain = word.isascii() and "_" not in word  # float takes 1_0 for 10
    number = float(word) if is_plain else np.nan
    if not abs(number) < MAX_NUMBER:
        raise ValueError(f"{word[:40]!r} is not a finite number")
    return number


def _scan_rows(
    path: Path, counts: tuple[int, ...], findings: Findings, separator: str | None = None
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
        numbers = parse_numbers(path, line, text.split(separator), counts[:1], findings)
        if numbers is None:
            continue
        if len(numbers) != 12 and numbers[0] <= last:
            findings.error(path, f"{numbers[0]:.15g} is not after {last:.15g} before it", line)
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
