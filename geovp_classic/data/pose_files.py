"""Trajectories as text files: KITTI (12 numbers a line, or 13 with the frame's index in front) and TUM.

KITTI: the rows of world_from_cam[:3] one after the other. TUM: `t x y z qx qy qz qw`, time in seconds, world_from_cam.
Blank lines and comments (#) are skipped. A `scan_` function returns what is good and a finding for every line that is
not; a `read_` function raises BadData for the first one.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from geovp_classic.data.findings import Finding, error, raise_first
from geovp_classic.data.text_tables import Row, read_rows, write_lines
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory

ROTATION_TOLERANCE = 1e-3  # of R R' - I and of a quaternion's length; the nearest rotation is taken within it
IndexArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class PoseTable:
    """The good rows of a pose file."""

    lines: tuple[int, ...]  # where each row stands
    keys: FloatArray | None  # [N] frame indices (KITTI with 13 numbers) or times in seconds (TUM)
    world_from_cam: FloatArray  # [N, 4, 4]


def read_kitti(path: Path) -> tuple[IndexArray | None, FloatArray]:
    """Frame indices [N] (None when the lines hold 12 numbers) and world_from_cam [N, 4, 4]."""
    table, findings = scan_kitti(path)
    raise_first(findings)
    return None if table.keys is None else table.keys.astype(np.int64), table.world_from_cam


def read_tum(path: Path, *, is_metric: bool = True) -> Trajectory:
    """The trajectory of a TUM file, which does not say whether its unit is the metre: the caller does."""
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
    """Whether a trajectory file is TUM (True) or KITTI (False), by the numbers on its first line."""
    rows, findings = read_rows(path)
    if not rows:
        raise_first([*findings, error(path, None, "holds no poses")])
    count = len(rows[0].numbers)
    if count not in (8, 12, 13):
        raise_first([error(path, rows[0].line, f"{count} numbers, expected 8 (TUM), 12 or 13 (KITTI)")])
    return count == 8


def read_trajectory(path: Path, times_s: FloatArray | None = None, *, is_metric: bool = True) -> Trajectory:
    """The trajectory of a TUM file, or of a KITTI file with the times of all frames, told apart by content.

    `times_s` is for KITTI files alone: their rows are frames 0, 1, ..., or those of the indices in front.
    """
    if has_times(path):
        return read_tum(path, is_metric=is_metric)
    indices, world_from_cam = read_kitti(path)
    if times_s is None:
        raise BadData(f"{path} is in KITTI's format, which has no times: give those of all frames")
    if indices is None and len(world_from_cam) != len(times_s):
        raise BadData(f"{path}: {len(world_from_cam)} poses for {len(times_s)} frames, expected one each")
    if indices is not None and indices[-1] >= len(times_s):
        raise BadData(f"{path}: a pose of frame {indices[-1]}, but frames end at {len(times_s) - 1}")
    return Trajectory(world_from_cam, times_s if indices is None else times_s[indices], is_metric)


def write_kitti(path: Path, trajectory: Trajectory, indices: IndexArray | None = None) -> None:
    """One line of 12 numbers a pose, 13 with the frame's index; exact to the last bit, written in one step."""
    lines = [_text(pose[:3].ravel()) for pose in trajectory.world_from_cam]
    if indices is not None:
        lines = [f"{index} {line}" for index, line in zip(indices.tolist(), lines, strict=True)]
    write_lines(path, lines)


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """One line `t x y z qx qy qz qw` a pose, exact to rounding, written in one step."""
    quaternions = Rotation.from_matrix(trajectory.world_from_cam[:, :3, :3]).as_quat()
    columns = [trajectory.times_s[:, None], trajectory.world_from_cam[:, :3, 3], quaternions]
    write_lines(path, ["# t_s x y z qx qy qz qw", *map(_text, np.hstack(columns))])


def scan_kitti(path: Path) -> tuple[PoseTable, list[Finding]]:
    """The good rows of a KITTI file, and what is wrong with the others."""
    rows, findings = read_rows(path)
    if not rows and not findings:
        findings.append(error(path, None, "holds no poses"))
    with_index = bool(rows) and len(rows[0].numbers) == 13
    expected = 13 if with_index else 12
    good = [row for row in rows if len(row.numbers) == expected]
    findings += [_wrong_count(path, row, rows[0]) for row in rows if len(row.numbers) != expected]
    if with_index:
        good = _increasing(path, good, "frame", findings)
    entries = np.array([row.numbers[-12:] for row in good]).reshape(-1, 3, 4)
    rotation = entries[:, :, :3]
    defect = np.abs(rotation @ np.swapaxes(rotation, 1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    proper = np.linalg.det(rotation) > 0
    for row, off, right_handed in zip(good, defect, proper, strict=True):
        if not off < ROTATION_TOLERANCE:
            findings.append(error(path, row.line, f"not a rotation matrix: R R' is off the identity by {off:.2g}"))
        elif not right_handed:
            findings.append(error(path, row.line, "not a rotation matrix but a reflection (determinant -1)"))
    return _table(good, (defect < ROTATION_TOLERANCE) & proper, entries, with_keys=with_index), _sorted(findings)


def scan_tum(path: Path) -> tuple[PoseTable, list[Finding]]:
    """The good rows of a TUM file, and what is wrong with the others."""
    rows, findings = read_rows(path)
    if not rows and not findings:
        findings.append(error(path, None, "holds no poses"))
    findings += [
        error(path, row.line, f"{len(row.numbers)} numbers, expected 8 (TUM: t x y z qx qy qz qw)")
        for row in rows
        if len(row.numbers) != 8
    ]
    good = _increasing(path, [row for row in rows if len(row.numbers) == 8], "time", findings)
    numbers = np.array([row.numbers for row in good]).reshape(-1, 8)
    length = np.linalg.norm(numbers[:, 4:], axis=1)
    unit = np.abs(length - 1) < ROTATION_TOLERANCE
    for row, value, fits in zip(good, length, unit, strict=True):
        if not fits:
            findings.append(error(path, row.line, f"the quaternion has length {value:.4g}, expected 1"))
    quaternions = np.where(unit[:, None], numbers[:, 4:], [0.0, 0.0, 0.0, 1.0])
    rotation = Rotation.from_quat(quaternions).as_matrix() if good else np.zeros((0, 3, 3))
    entries = np.concatenate([rotation, numbers[:, 1:4, None]], axis=2)
    return _table(good, unit, entries, with_keys=True), _sorted(findings)


def scan_times(path: Path) -> tuple[FloatArray, tuple[int, ...], list[Finding]]:
    """The good times [N] in seconds, the lines they stand on, and what is wrong with the others."""
    rows, findings = read_rows(path)
    if not rows and not findings:
        findings.append(error(path, None, "holds no times"))
    findings += [
        error(path, row.line, f"{len(row.numbers)} numbers, expected one time in seconds")
        for row in rows
        if len(row.numbers) != 1
    ]
    good = _increasing(path, [row for row in rows if len(row.numbers) == 1], "time", findings)
    return np.array([row.numbers[0] for row in good]), tuple(row.line for row in good), _sorted(findings)


def _increasing(path: Path, rows: list[Row], what: str, findings: list[Finding]) -> list[Row]:
    """The rows whose first number is larger than all before it (and whole, when frames are counted)."""
    kept: list[Row] = []
    for row in rows:
        value = row.numbers[0]
        if what == "frame" and (value < 0 or value != int(value)):
            findings.append(error(path, row.line, f"frame index {value:g}, expected a whole number from 0"))
        elif kept and value <= kept[-1].numbers[0]:
            before = kept[-1]
            findings.append(
                error(path, row.line, f"{what} {value!r} is not after {before.numbers[0]!r} of line {before.line}")
            )
        else:
            kept.append(row)
    return kept


def _wrong_count(path: Path, row: Row, first: Row) -> Finding:
    if row is not first and len(row.numbers) in (12, 13):
        return error(path, row.line, f"{len(row.numbers)} numbers, but line {first.line} has {len(first.numbers)}")
    return error(path, row.line, f"{len(row.numbers)} numbers, expected 12 (KITTI) or 13 (with a frame index)")


def _table(rows: list[Row], good: npt.NDArray[np.bool_], entries: FloatArray, *, with_keys: bool) -> PoseTable:
    kept = [row for row, fits in zip(rows, good, strict=True) if fits]
    world_from_cam = se3.compose(entries[good][:, :, :3], entries[good][:, :, 3])
    if kept:
        world_from_cam = se3.orthonormalised(world_from_cam, ROTATION_TOLERANCE)
    keys = np.array([row.numbers[0] for row in kept]) if with_keys else None
    return PoseTable(tuple(row.line for row in kept), keys, world_from_cam)


def _sorted(findings: list[Finding]) -> list[Finding]:
    return sorted(findings, key=lambda finding: finding.line or 0)


def _text(numbers: FloatArray) -> str:
    return " ".join(repr(float(number)) for number in numbers)
