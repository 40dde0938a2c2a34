"""Check sequences of TUM RGB-D, EuRoC and COLMAP, and plain folders of images."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from geovp_classic.data import folder, layouts, plausibility
from geovp_classic.data.findings import Finding, error
from geovp_classic.data.frames import image_files
from geovp_classic.data.pose_files import PoseTable
from geovp_classic.data.posed_sequences import Scanned
from geovp_classic.data.undistortion import common_pinhole
from geovp_classic.errors import BadData

NO_CALIBRATION = (
    "has no calibration that is known: give intrinsics = [fx, fy, cx, cy] to the data set"
)
NO_POSES = "has no recorded poses: it serves for prediction without ground truth"


def folders(root: Path, kind: str) -> dict[str, Path]:
    """The sequences of a root by name."""
    return folder.paths_below(root) if kind == "folder" else layouts.POSED[kind].folders(root)


def sequence(
    root: Path, name: str, deep: bool, findings: list[Finding]
) -> tuple[dict[str, str], int]:
    """The table row of a sequence, and the number of its frames; findings are added."""
    kind = layouts.name_of(root)
    path, own = folders(root, kind)[name], list[Finding]()
    try:
        scanned = _images(path) if kind == "folder" else layouts.POSED[kind].scan(path)
    except BadData as problem:
        scanned = Scanned(
            (), np.zeros(0), (), (error(path, None, str(problem).removeprefix(f"{path} ")),)
        )
    own += scanned.findings
    sizes_px = plausibility.image_sizes(scanned.images, deep, own)
    view = _calibration(path, scanned, sizes_px, own)
    table = _poses(path, scanned, own)
    numbers = np.arange(len(scanned.images))
    for late in plausibility.late_frames(path, scanned.times_s, numbers, numbers.tolist()):
        own.append(replace(late, path=scanned.images[late.line or 0], line=None))
    findings += own
    count, is_metric = len(scanned.images), scanned.is_metric
    row = plausibility.table_row(
        name, str(count), sizes_px, view, scanned.times_s, table, own, is_metric=is_metric
    )
    return row, count


def _images(path: Path) -> Scanned:
    paths = tuple(image_files(path))
    return Scanned(paths, np.arange(len(paths)) / folder.FOLDER_RATE_HZ, (), ())


def _calibration(
    path: Path, scanned: Scanned, sizes_px: tuple[tuple[int, int], ...], findings: list[Finding]
) -> str:
    """The focal length for people; a camera must fit its images."""
    if not scanned.cameras:
        if scanned.images and not scanned.findings:
            findings.append(Finding(path, None, "note", NO_CALIBRATION))
        return "none"
    calibrated = {(camera.width_px, camera.height_px) for camera in scanned.cameras}
    for width_px, height_px in sorted(set(sizes_px) - calibrated):
        expected = ", ".join(f"{each[0]}x{each[1]}" for each in sorted(calibrated))
        findings.append(
            error(path, None, f"has images of {width_px}x{height_px}, calibrated for {expected}")
        )
    try:
        view = common_pinhole(scanned.cameras, path)
    except BadData as problem:
        findings.append(error(path, None, str(problem).removeprefix(f"{path}: ")))
        return "none"
    if odd := plausibility.off_centre(
        np.array([view.cx_px, view.cy_px]), (view.width_px, view.height_px)
    ):
        findings.append(
            Finding(path, None, "warning", f"has {odd}: were images resized or cropped without it?")
        )
    return f"f {view.fx_px:.0f} px"


def _poses(path: Path, scanned: Scanned, findings: list[Finding]) -> PoseTable | None:
    """The poses of the images that have one; lines are the images' numbers, from 1."""
    if scanned.world_from_cam is None:
        findings += [Finding(path, None, "note", NO_POSES)] if scanned.images else []
        return None
    numbers, count = scanned.posed, len(scanned.images)
    if len(numbers) < count:
        pieces = f"leaving {len(scanned.breaks) + 1 if len(numbers) else 0} unbroken pieces"
        findings.append(
            Finding(
                path,
                None,
                "warning",
                f"{count - len(numbers)} of {count} images have no pose, {pieces}",
            )
        )
    if scanned.depths is not None and (without := sum(depth is None for depth in scanned.depths)):
        findings.append(
            Finding(path, None, "warning", f"{without} of {count} images have no depth image")
        )
    table = PoseTable(tuple((numbers + 1).tolist()), None, scanned.world_from_cam[numbers])
    for jump in plausibility.jumps(path, table, scanned.times_s[numbers]):
        if scanned.is_metric or "turned" in jump.message:
            findings.append(
                Finding(scanned.images[(jump.line or 1) - 1], None, "warning", jump.message)
            )
    return table
