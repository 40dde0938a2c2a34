"""Signs that a prediction's motion is wrong, found in the observed frames alone."""

from pathlib import Path

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.odometry.speed_prior import MIN_SPREAD
from geovp_classic.types import Context, Motion

MIN_TRACKED_SHARE = 0.7
MAX_OFF_AXIS_DEG = 6.0  # between the optical axis and the direction of travel; at most 2 on KITTI
STRAIGHT_RAD = np.radians(
    1.0
)  # a step with less rotation: in turns a car's camera does travel sideways


def off_axis_deg(motion: Motion) -> float | None:
    """The angle between the optical axis and the direction of travel, straight on; None where that
    never was.

    A camera that looks where it goes travels along its axis: an offset of the principal point turns
    its path by the angle of that offset, and leaves the observed frames explained.
    """
    poses = motion.past.world_from_cam
    steps = se3.inverse(poses[:-1]) @ poses[1:]
    lengths = np.linalg.norm(steps[:, :3, 3], axis=1)
    straight = np.array([se3.rotation_angle_rad(step) < STRAIGHT_RAD for step in steps])
    usable = straight & (lengths > 0.2 * lengths.max()) & motion.tracked[1:]
    if not usable.any() or stands(motion):
        return None
    right, down, ahead = np.median(steps[usable, :3, 3] / lengths[usable, None], axis=0)
    return float(np.degrees(np.arctan2(np.hypot(right, down), abs(ahead))))


def stands(motion: Motion) -> bool:
    """Whether the camera never moved while it was observed."""
    return not np.ptp(motion.past.world_from_cam[:, :3, 3], axis=0).any()


def warnings(context: Context, motion: Motion) -> list[str]:
    """Return a sentence for each sign that the motion is not to be trusted."""
    found, tracked = [], motion.tracked
    if tracked.mean() < MIN_TRACKED_SHARE:
        count = f"only {int(tracked.sum())} of {len(tracked)} observed frames could be tracked"
        found.append(
            f"{count}: the motion is mostly a guess; give sharper frames or a larger --size"
        )
    angle_deg = off_axis_deg(motion)
    if angle_deg is not None and angle_deg > MAX_OFF_AXIS_DEG:
        travels = f"the camera travels {angle_deg:.0f} degrees off its optical axis"
        found.append(f"{travels}: unless it is mounted like that, the principal point is wrong")
    uncertainty = motion.past.scale_uncertainty or 0.0
    if uncertainty >= MIN_SPREAD:
        found.append(
            "no road was found below the camera: scale from a prior of driving speeds, +- "
            f"{uncertainty:.0%}"
        )
    elif context.camera_height_m is not None and not motion.past.is_metric:
        found.append(
            "no road was found below the camera, so lengths are not in metres in spite of "
            "--camera-height"
        )
    if stands(motion):
        found.append(
            "the camera is stationary, so the prediction is static and there is no cloud.ply"
        )
    return found


def free_memory_bytes() -> float:
    """Memory that new work can take; infinite where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return next(
            1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")
        )
    except (OSError, StopIteration):
        return np.inf
