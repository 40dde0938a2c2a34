"""Text files of numbers: trajectories in KITTI's format (12 or 13 numbers a line) or TUM's (8), and
times.

KITTI: the rows of world_from_cam[:3] one after the other, with or without the frame index in front.
TUM: `t x y z qx qy qz qw`, time in seconds, world_from_cam. Blank lines and comments (#) are
skipped. A `scan_` function returns the good rows and a finding for every bad line; a `read_`
function raises BadData for the first bad line.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from geovp_classic import files
from geovp_classic.data.atomic import atomic_write
from geovp_classic.data.findings import Finding, error, raise_first
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory

ROTATION_TOLERANCE = (
    1e-3  # of R R' - I and of a quaternion's length; the nearest rotation is taken within it
)
LARGEST = 2.0**63  # times in nanoseconds are below it
LONGEST_STEP_S = 60.0  # from time to time, more often than not: longer ones are not in seconds
FARTHEST = 1e9  # a position; the Earth is 1.3e7 m wide
_WORD = re.compile(
    r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf|infinity)", re.ASCII | re.IGNORECASE
)
IndexArray = npt.NDArray[np.int64]


class Row(NamedTuple):
    """The numbers of one line, all finite."""

    line: int
    numbers: tuple[float, ...]


@dataclass(frozen=True)
class PoseTable:
    """The good rows of a pose file."""

    lines: tuple[int, ...]  # [N] line numbers
    keys: FloatArray | None  # [N] frame indices (KITTI with 13 numbers) or times in seconds (TUM)
    world_from_cam: FloatArray  # [N, 4, 4]


def read_kitti(path: Path) -> tuple[IndexArray | None, FloatArray]:
    """Frame indices [N] (None when the lines hold 12 numbers) and world_from_cam [N, 4, 4]."""
    table, findings = scan_kitti(path)
    raise_first(findings)
    return None if table.keys is None else table.keys.astype(np.int64), table.world_from_cam


def read_tum(path: Path, *, is_metric: bool = True) -> Trajectory:
    """The trajectory of a TUM file; the file does not say whether its unit is the metre, so the
    caller does.
    """
    table, findings = scan_tum(path)
    raise_first(findings)
    assert table.keys is not None
    return Trajectory(table.world_from_cam, table.keys, is_metric)


def read_times(path: Path) -> FloatArray:
    """The times in seconds [N] of a file with one increasing number a line."""
    times_s, _, findings = scan_times(path)
    raise_first(findings)
    return times_s


def has_times(path: Path) -> bool:
    """Whether a trajectory file is TUM (True) or KITTI (False), by the numbers on its
    first line.
    """
    rows, findings = _read_rows(path, "poses")
    if not rows:
        raise_first(findings)
    count = len(rows[0].numbers)
    if count not in (8, 12, 13):
        raise_first(
            [error(path, rows[0].line, f"{count} numbers, expected 8 (TUM), 12 or 13 (KITTI)")]
        )
    return count == 8


def read_trajectory(
    path: Path, times_s: FloatArray | None = None, *, is_metric: bool = True
) -> Trajectory:
    """The trajectory of a TUM file, or of a KITTI file with the times of all frames, told apart by
    content.

    `times_s` is for KITTI files alone: their rows are frames 0, 1, ..., or those of the indices in
    front.
    """
    if has_times(path):
        return read_tum(path, is_metric=is_metric)
    indices, world_from_cam = read_kitti(path)
    if times_s is None:
        raise BadData(f"{path} is in KITTI's format, which has no times: give those of all frames")
    if indices is None and len(world_from_cam) != len(times_s):
        raise BadData(
            f"{path}: {len(world_from_cam)} poses for {len(times_s)} frames, expected one each"
        )
    if indices is not None and indices[-1] >= len(times_s):
        raise BadData(
            f"{path}: a pose of frame {indices[-1]}, but frames end at {len(times_s) - 1}"
        )
    return Trajectory(world_from_cam, times_s if indices is None else times_s[indices], is_metric)


def write_kitti(path: Path, trajectory: Trajectory) -> None:
    """One line of 12 numbers a pose, exact to the last bit, written atomically."""
    _write_rows(path, trajectory.world_from_cam[:, :3].reshape(-1, 12))


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """One line `t x y z qx qy qz qw` a pose, exact to rounding, written atomically."""
    quaternions = Rotation.from_matrix(trajectory.world_from_cam[:, :3, :3]).as_quat()
    columns = [trajectory.times_s[:, None], trajectory.world_from_cam[:, :3, 3], quaternions]
    _write_rows(path, np.hstack(columns), "# t_s x y z qx qy qz qw\n")


def scan_kitti(path: Path) -> tuple[PoseTable, list[Finding]]:
    """The good rows of a KITTI file, and the errors of the others."""
    expected = "12 (KITTI) or 13 (with a frame index), the same on every line"
    rows, findings = _scan_rows(path, "poses", (12, 13), expected)
    entries = np.array([row.numbers[-12:] for row in rows]).reshape(-1, 3, 4)
    rotation = np.clip(entries[:, :, :3], -1e3, 1e3)  # whose products do not overflow
    defect = np.abs(rotation @ np.swapaxes(rotation, 1, 2) - np.eye(3)).max(
        axis=(1, 2), initial=0.0
    )
    problems = [
        f"not a rotation matrix: R R' is off the identity by {value:.2g}" for value in defect
    ]
    for number in np.flatnonzero(defect < ROTATION_TOLERANCE):
        mirrored = np.linalg.det(rotation[number]) < 0
        problems[number] = (
            "not a rotation matrix but a reflection (determinant -1)" if mirrored else ""
        )
    return _pose_table(path, rows, entries, problems, findings)


def scan_tum(path: Path) -> tuple[PoseTable, list[Finding]]:
    """The good rows of a TUM file, and the errors of the others."""
    return _quaternion_table(path, *_scan_rows(path, "poses", (8,), "8 (TUM: t x y z qx qy qz qw)"))


def scan_asl(path: Path, start_ns: float) -> tuple[PoseTable, list[Finding]]:
    """The good rows of a data.csv of EuRoC, times in seconds after a start, and the errors of the
    others.
    """
    expected = "8 or 17 (time in ns, x, y, z, qw, qx, qy, qz, ...)"
    rows, findings = _scan_rows(path, "poses", (17, 8), expected, separator=",")
    order = (1, 2, 3, 5, 6, 7, 4)  # x, y, z, qx, qy, qz, qw
    found = [
        Row(line, ((numbers[0] - start_ns) / 1e9, *(numbers[i] for i in order)))
        for line, numbers in rows
    ]
    return _quaternion_table(path, found, findings)


def _quaternion_table(
    path: Path, rows: list[Row], findings: list[Finding]
) -> tuple[PoseTable, list[Finding]]:
    numbers = np.array([row.numbers for row in rows]).reshape(-1, 8)
    length = np.linalg.norm(numbers[:, 4:], axis=1)
    is_unit = np.abs(length - 1) < ROTATION_TOLERANCE
    quaternions = np.where(is_unit[:, None], numbers[:, 4:], [0.0, 0.0, 0.0, 1.0])
    rotation = Rotation.from_quat(quaternions).as_matrix() if rows else np.zeros((0, 3, 3))
    entries = np.concatenate([rotation, numbers[:, 1:4, None]], axis=2)
    message = [f"the quaternion has length {value:.4g}, expected 1" for value in length]
    return _pose_table(path, rows, entries, list(np.where(is_unit, "", message)), findings)


def scan_times(path: Path) -> tuple[FloatArray, tuple[int, ...], list[Finding]]:
    """The good times [N] in seconds, their line numbers, and the errors of the other lines."""
    rows, findings = _scan_rows(path, "times", (1,), "one time in seconds")
    times_s = np.array([row.numbers[0] for row in rows])
    if len(times_s) > 1 and (step_s := float(np.median(np.diff(times_s)))) > LONGEST_STEP_S:
        findings.append(
            error(
                path,
                None,
                f"half of the times are {step_s:.4g} or more apart, expected times in seconds",
            )
        )
    return times_s, tuple(row.line for row in rows), _sorted(findings)


def read_lines(path: Path) -> tuple[list[tuple[int, str]], list[Finding]]:
    """(line number, text) of every line that is not empty once comments (#) are removed."""
    try:
        text = files.read_text(path)
    except BadData as problem:
        missing = not path.exists()
        return [], [
            error(
                path, None, "does not exist" if missing else str(problem).removeprefix(f"{path} ")
            )
        ]
    lines = [
        (number, line.partition("#")[0].strip())
        for number, line in enumerate(text.splitlines(), start=1)
    ]
    return [(number, line) for number, line in lines if line], []


def parse_row(path: Path, line: int, text: str) -> Row | Finding:
    """The numbers of one line, or the first error in it."""
    numbers = []
    for word in text.split():
        if not _WORD.fullmatch(word):  # float also takes 1_0 for 10, and digits of other scripts
            return error(path, line, f"{word[:40]!r} is not a number")
        numbers.append(float(word))
        if not abs(numbers[-1]) < LARGEST:
            problem = "too large" if word[-1].isdigit() else "not finite"
            return error(path, line, f"{word[:40]!r} is {problem}: every number must be known")
    return Row(line, tuple(numbers))


def _read_rows(path: Path, what: str, separator: str = " ") -> tuple[list[Row], list[Finding]]:
    lines, findings = read_lines(path)
    if not lines and not findings:
        findings.append(error(path, None, f"holds no {what}"))
    parsed = [parse_row(path, number, line.replace(separator, " ")) for number, line in lines]
    findings += [row for row in parsed if isinstance(row, Finding)]
    return [row for row in parsed if isinstance(row, Row)], findings


def _scan_rows(
    path: Path, what: str, lengths: tuple[int, ...], expected: str, separator: str = " "
) -> tuple[list[Row], list[Finding]]:
    """The rows as long as the first, whose first numbers, if they are times or frame indices,
    increase.
    """
    rows, findings = _read_rows(path, what, separator)
    length = len(rows[0].numbers) if rows and len(rows[0].numbers) in lengths else lengths[0]
    good: list[Row] = []
    for row in rows:
        if len(row.numbers) != length:
            problem = f"{len(row.numbers)} numbers, expected {expected}"
        else:
            problem = "" if length == 12 else _key_problem(row, good[-1] if good else None)
        if problem:
            findings.append(error(path, row.line, problem))
        else:
            good.append(row)
    return good, findings


def _key_problem(row: Row, before: Row | None) -> str:
    """Why a row's frame index (of 13 numbers) or time is wrong; empty when it is not."""
    key, is_index = row.numbers[0], len(row.numbers) == 13
    if is_index and (key < 0 or key != int(key)):
        return f"frame index {key:g}, expected a whole number from 0"
    if before is None or key > before.numbers[0]:
        return ""
    return (
        f"{'frame' if is_index else 'time'} {key!r} is not after {before.numbers[0]!r} of line "
        f"{before.line}"
    )


def _pose_table(
    path: Path,
    rows: list[Row],  # N
    entries: FloatArray,  # [N, 3, 4]
    problems: list[str],  # N, empty for a good row
    findings: list[Finding],
) -> tuple[PoseTable, list[Finding]]:
    far = np.abs(entries[:, :, 3]).max(axis=1, initial=0.0)
    problems = [
        problem
        or (
            ""
            if distance <= FARTHEST
            else f"a position of {distance:.3g}, expected at most {FARTHEST:g}"
        )
        for problem, distance in zip(problems, far, strict=True)
    ]
    findings += [
        error(path, row.line, problem)
        for row, problem in zip(rows, problems, strict=True)
        if problem
    ]
    good = [number for number, problem in enumerate(problems) if not problem]
    world_from_cam = se3.compose(entries[good][:, :, :3], entries[good][:, :, 3])
    if good:
        world_from_cam = se3.orthonormalised(world_from_cam, ROTATION_TOLERANCE)
    with_keys = bool(rows) and len(rows[0].numbers) != 12
    keys = np.array([rows[number].numbers[0] for number in good]) if with_keys else None
    return PoseTable(tuple(rows[number].line for number in good), keys, world_from_cam), _sorted(
        findings
    )


def _sorted(findings: list[Finding]) -> list[Finding]:
    return sorted(findings, key=lambda finding: finding.line or 0)


def _write_rows(path: Path, rows: FloatArray, header: str = "") -> None:
    """Nobody reads half a file; BadData when it cannot be written."""
    try:
        with atomic_write(path) as scratch:
            lines = (" ".join(map(repr, row)) + "\n" for row in rows.tolist())
            scratch.write_text(header + "".join(lines), encoding="utf-8")
    except OSError as problem:
        message = (
            f"{path} cannot be written ({problem.strerror}): give a file in a folder that can be "
            "written"
        )
        raise BadData(message) from problem
