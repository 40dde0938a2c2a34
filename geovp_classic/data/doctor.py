"""Check the folder of a data set: list everything that is there and all that is wrong, by file and
line.

The loader stops at the first error of what it needs; the doctor reads every sequence, camera and
pose.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from geovp_classic.data import (
    kitti_layout,
    kitti_raw_layout,
    layouts,
    plausibility,
    pose_files,
    posed_doctor,
    splits,
)
from geovp_classic.data.findings import Finding, error
from geovp_classic.data.frames import scan_numbered
from geovp_classic.data.pose_files import IndexArray, PoseTable
from geovp_classic.data.windows import FrameRange
from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray

NO_POSES = "does not exist: the sequence serves for prediction without ground truth"
ScanTimes = Callable[[Path], tuple[FloatArray, tuple[int, ...], list[Finding]]]
ExamineOne = Callable[[Path, str, bool, list[Finding]], tuple[dict[str, str], int]]


@dataclass(frozen=True)
class Camera:
    """The contents of one folder image_K."""

    number: int
    num_frames: int
    sizes_px: tuple[tuple[int, int], ...]  # every (width, height) that occurs


@dataclass(frozen=True)
class Examination:
    """The contents of a root, and its findings."""

    rows: tuple[dict[str, str], ...]  # a table row for every sequence, by column
    findings: tuple[Finding, ...]  # sequence by sequence
    usable_splits: tuple[str, ...]  # the named splits whose frames are all here

    @property
    def is_sound(self) -> bool:
        """Whether there is no error; there may be warnings and notes."""
        return not any(finding.severity == "error" for finding in self.findings)


def examine(
    root: Path, *, deep: bool = False, watch: Callable[[list[str]], Iterable[str]] = iter
) -> Examination:
    """Everything under a root; headers and ends of images are read, with `deep` every image is
    decoded.

    The sequences' names go through `watch` one by one, which may show a progress bar (tqdm does).
    BadData only when the root holds no sequences at all.
    """
    names, examine_one = _sequences(root)
    rows, findings, num_frames = [], [], {}
    for name in watch(names):
        found: list[Finding] = []
        row, num_frames[name] = examine_one(root, name, deep, found)
        rows.append(row)
        findings += found
    for path in sorted((root / "poses").glob("*.txt")):
        if path.stem not in names:
            message = f"there is no sequence {path.stem!r} with images for these poses"
            findings.append(Finding(path, None, "note", message))
    return Examination(tuple(rows), tuple(findings), _usable_splits(num_frames))


def _sequences(root: Path) -> tuple[list[str], ExamineOne]:
    """The names of a root's sequences, and what examines one."""
    kind = layouts.name_of(root)
    if kind == "kitti-raw":
        names, expected = (
            kitti_raw_layout.sequence_names(root),
            "a date's folder with folders *_drive_*_sync",
        )
    elif kind == "kitti":
        names, expected = (
            kitti_layout.sequence_names(root),
            "folders such as 00 with image_2, calib.txt",
        )
    else:
        return list(posed_doctor.folders(root, kind)), posed_doctor.sequence
    if not names:
        raise BadData(
            f"{root if kind == 'kitti-raw' else root / 'sequences'} holds no sequence: expected "
            f"{expected}"
        )
    return names, _drive if kind == "kitti-raw" else _sequence


def _sequence(
    root: Path, name: str, deep: bool, findings: list[Finding]
) -> tuple[dict[str, str], int]:
    """The table row of a sequence, and the number of frames that all its cameras have."""
    folder = root / "sequences" / name
    cameras = [
        _camera(folder / f"image_{camera}", camera, deep, findings)
        for camera in kitti_layout.cameras(folder)
    ]
    calibrated = _calibration(folder / "calib.txt", cameras, findings)
    num_frames = _same_length(folder, cameras, findings)
    times_s = _times(folder / "times.txt", num_frames, findings)
    table = _poses(root / "poses" / f"{name}.txt", num_frames, times_s, findings)
    return _row(name, cameras, calibrated, times_s, table, findings)


def _drive(
    root: Path, name: str, deep: bool, findings: list[Finding]
) -> tuple[dict[str, str], int]:
    """The same of a drive of KITTI raw, whose cameras have times of their own."""
    folder, prefix = kitti_raw_layout.drive_folder(root, name), kitti_raw_layout.PREFIX
    numbers = kitti_layout.cameras(folder, prefix)
    cameras = [
        _camera(folder / f"{prefix}{camera}" / "data", camera, deep, findings) for camera in numbers
    ]
    calibration = folder.parent / kitti_raw_layout.CAM_TO_CAM
    calibrated = _calibration(calibration, cameras, findings)
    for camera in cameras:
        for size_px in camera.sizes_px[:1]:
            findings += kitti_raw_layout.scan_sizes(calibration, camera.number, size_px)
    num_frames, scan = _same_length(folder, cameras, findings), kitti_raw_layout.scan_timestamps
    stamps = {camera: folder / f"{prefix}{camera.number}" / "timestamps.txt" for camera in cameras}
    times_s = [
        _times(path, camera.num_frames, findings, scan) for camera, path in stamps.items()
    ] or [np.zeros(0)]
    if not (folder / "oxts").is_dir():
        findings.append(Finding(folder / "oxts", None, "note", NO_POSES))
        return _row(name, cameras, calibrated, times_s[0], None, findings)
    table, found = kitti_raw_layout.scan_poses(folder, num_frames)
    findings += found
    if len(table.lines) == len(times_s[0]):
        for jump in plausibility.jumps(
            folder / "oxts" / "data", table, times_s[0]
        ):  # its line is the number of the file, from 1
            findings.append(
                replace(jump, path=jump.path / f"{(jump.line or 1) - 1:010d}.txt", line=1)
            )
    return _row(name, cameras, calibrated, times_s[0], table, findings)


def _same_length(folder: Path, cameras: list[Camera], findings: list[Finding]) -> int:
    """The most frames that a camera has; an error where there is no camera or they differ."""
    if not cameras:
        findings.append(error(folder, None, kitti_layout.NO_IMAGES))
    counts = {camera.num_frames for camera in cameras} or {0}
    if len(counts) > 1:
        message = ", ".join(f"image_{camera.number} has {camera.num_frames}" for camera in cameras)
        findings.append(error(folder, None, f"cameras have different numbers of frames: {message}"))
    return max(counts)


def _row(
    name: str,
    cameras: list[Camera],
    calibrated: tuple[int, ...],
    times_s: FloatArray,
    table: PoseTable | None,
    findings: list[Finding],
) -> tuple[dict[str, str], int]:
    sizes_px = sorted({size_px for camera in cameras for size_px in camera.sizes_px})
    frames = (
        ", ".join(f"image_{camera.number}: {camera.num_frames}" for camera in cameras) or "none"
    )
    projections = ", ".join(f"P{camera}" for camera in calibrated) or "none"
    row = plausibility.table_row(name, frames, sizes_px, projections, times_s, table, findings)
    return row, min((camera.num_frames for camera in cameras), default=0)


def _camera(images: Path, camera: int, deep: bool, findings: list[Finding]) -> Camera:
    """The images of one camera: numbering, sizes, damage."""
    paths, found = scan_numbered(images)
    findings += found
    return Camera(camera, len(paths), plausibility.image_sizes(paths, deep, findings))


def _calibration(path: Path, cameras: list[Camera], findings: list[Finding]) -> tuple[int, ...]:
    """The cameras with a projection; each camera with images must have one that fits them."""
    projections, found = kitti_layout.scan_calibration(path)
    findings += found
    for camera in cameras:
        projection = projections.get(camera.number)
        if projection is None:
            findings += [] if found else [kitti_layout.missing_projection(path, camera.number)]
            continue
        for size_px in camera.sizes_px[:1]:
            if odd := plausibility.off_centre(projection.matrix[:2, 2], size_px):
                hint = (
                    f"of {size_px[0]}x{size_px[1]} images: were they resized or cropped without it?"
                )
                findings.append(
                    Finding(path, projection.line, "warning", f"P{camera.number} puts {odd} {hint}")
                )
    return tuple(sorted(projections))


def _times(
    path: Path, num_frames: int, findings: list[Finding], scan: ScanTimes = pose_files.scan_times
) -> FloatArray:
    times_s, lines, found = scan(path)
    findings += found
    numbers, num_rows = _row_numbers(lines, found)
    if num_rows and num_rows != num_frames:
        findings.append(
            error(path, None, f"{num_rows} times for {num_frames} frames, expected one each")
        )
    findings += plausibility.late_frames(path, times_s, numbers, lines)
    return times_s


def _poses(
    path: Path, num_frames: int, times_s: FloatArray, findings: list[Finding]
) -> PoseTable | None:
    if not path.exists():
        findings.append(Finding(path, None, "note", NO_POSES))
        return None
    table, found = pose_files.scan_kitti(path)
    findings += found
    numbers, num_rows = _row_numbers(table.lines, found)
    problem = kitti_layout.pose_count_problem(table.keys, num_rows, num_frames) if num_rows else ""
    findings += [error(path, None, problem)] if problem else []
    if len(times_s) == num_frames and not problem:
        findings += plausibility.jumps(
            path, table, times_s[numbers if table.keys is None else table.keys.astype(np.int64)]
        )
    return table


def _row_numbers(good_lines: tuple[int, ...], findings: list[Finding]) -> tuple[IndexArray, int]:
    """The number of every good row, the first row being 0, and the number of all rows, bad ones
    included.
    """
    all_lines = sorted({*good_lines, *(finding.line for finding in findings if finding.line)})
    return np.searchsorted(all_lines, good_lines).astype(np.int64), len(all_lines)


def _usable_splits(num_frames: dict[str, int]) -> tuple[str, ...]:
    """The named splits whose frames are all among the sequences' first `num_frames`."""

    def is_here(frames: FrameRange) -> bool:
        return num_frames.get(frames.sequence, 0) >= max(frames.last or 1, frames.first + 1)

    return tuple(name for name in splits.names() if all(map(is_here, splits.load(name))))
