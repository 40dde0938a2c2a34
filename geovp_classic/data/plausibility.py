"""What the files of a sequence may say and yet not be true: motion that no camera makes, dropped
frames, odd images.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from geovp_classic.data.findings import Finding, error
from geovp_classic.data.frames import image_size
from geovp_classic.data.pose_files import IndexArray, PoseTable
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

MAX_SPEED_M_S = 60.0  # 216 km/h; 26 m/s at most in KITTI
MAX_TURN_DEG = 20.0  # between two frames; 5 degrees at most in KITTI
MAX_STEP_RATIO = 1.8  # a longer time step, in medians, is a dropped frame
PRINCIPAL_POINT_RANGE = (0.3, 0.7)  # of the image's width and height


def jumps(path: Path, table: PoseTable, times_s: FloatArray) -> Iterator[Finding]:
    """Warnings for motion that no car makes; one time for each good pose."""
    speed_m_s = steps_m(table) / np.diff(times_s)
    earlier, later = table.world_from_cam[:-1], table.world_from_cam[1:]
    turn_deg = (
        np.degrees(se3.rotation_angle_rad(se3.inverse(earlier) @ later))
        if len(later)
        else speed_m_s
    )
    for step in np.flatnonzero(speed_m_s > MAX_SPEED_M_S):
        message = f"{speed_m_s[step]:.0f} m/s from the pose before: more than a car drives"
        yield Finding(path, table.lines[step + 1], "warning", message)
    for step in np.flatnonzero(turn_deg > MAX_TURN_DEG):
        message = (
            f"turned by {turn_deg[step]:.0f} degrees from the pose before: more than a car turns"
        )
        yield Finding(path, table.lines[step + 1], "warning", message)


def steps_m(table: PoseTable) -> FloatArray:
    """The distance from each pose to the next [N - 1], in metres."""
    return np.linalg.norm(np.diff(table.world_from_cam[:, :3, 3], axis=0), axis=1)


def late_frames(
    path: Path,
    times_s: FloatArray,  # [N]
    numbers: IndexArray,  # [N], of the frames that the times belong to
    lines: Sequence[int],  # N
) -> Iterator[Finding]:
    """Warnings for times that are much later than the one before them."""
    steps_s = np.diff(times_s) / np.diff(numbers)
    usual_s = np.median(steps_s) if len(steps_s) else 0.0
    for step in np.flatnonzero(steps_s > MAX_STEP_RATIO * usual_s):
        message = (
            f"{steps_s[step]:.3f} s after the time before, {usual_s:.3f} s is usual: frames are "
            "missing"
        )
        yield Finding(path, lines[int(step) + 1], "warning", message)


def table_row(
    name: str,
    frames: str,
    sizes_px: Iterable[tuple[int, int]],  # (width, height)
    calibrated: str,
    times_s: FloatArray,
    table: PoseTable | None,
    findings: Iterable[Finding],
    *,
    is_metric: bool = True,
) -> dict[str, str]:
    """What the doctor's table says of a sequence, by column."""
    return {
        "sequence": name,
        "frames": frames,
        "size_px": ", ".join(f"{width_px}x{height_px}" for width_px, height_px in sizes_px) or "-",
        "calibrated": calibrated,
        "times": str(len(times_s)),
        "duration_s": f"{np.ptp(times_s) if len(times_s) else 0.0:.1f}",
        "poses": "none" if table is None else str(len(table.lines)),
        "length_m": "-" if table is None or not is_metric else f"{steps_m(table).sum():.0f}",
        **{
            f"{kind}s": str(sum(each.severity == kind for each in findings))
            for kind in ("error", "warning")
        },
    }


def off_centre(centre_px: FloatArray, size_px: tuple[int, int]) -> str:
    """Where an odd principal point lies; "" for a usual one."""
    at = centre_px / size_px
    usual = (at > PRINCIPAL_POINT_RANGE[0]) & (at < PRINCIPAL_POINT_RANGE[1])
    return (
        ""
        if usual.all()
        else f"the principal point at {at[0]:.0%} of the width, {at[1]:.0%} of the height"
    )


def image_sizes(
    paths: Iterable[Path], deep: bool, findings: list[Finding]
) -> tuple[tuple[int, int], ...]:
    """Every (width, height) that occurs; the first image, or with `deep` every one, is decoded."""
    sizes_px: dict[tuple[int, int], Path] = {}
    for path in paths:
        try:
            width_px, height_px = image_size(path, deep=deep or not sizes_px)
        except BadData as problem:
            findings.append(error(path, None, str(problem).removeprefix(f"{path} ")))
            continue
        first = next(iter(sizes_px), (width_px, height_px))
        if (
            sizes_px.setdefault((width_px, height_px), path) is path
            and (width_px, height_px) != first
        ):
            message = (
                f"is {width_px}x{height_px} pixels, but those before are {first[0]}x{first[1]}"
            )
            findings.append(error(path, None, message))
    return tuple(sizes_px)
