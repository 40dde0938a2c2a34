"""Signs that a prediction's motion is wrong, measured in the observed frames alone."""

from pathlib import Path

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.odometry.speed_prior import MIN_SPREAD
from geovp_classic.types import Context, Motion


def off_axis_deg(
    motion: Motion,
    min_speed_m_s: float = 1.0,  # braking pitches a slower camera
    lever_arm_m: float = 2.0,  # of a camera in front of a car's rear axle
    slow_speed_m_s: float = 3.0,  # assumed where lengths are not in metres
) -> float | None:
    """Return the angle between optical axis and direction of travel that turning cannot explain.

    A wrong principal point turns the path by the angle of its offset. A camera in front of the rear
    axle also moves sideways in turns, by yaw rate times lever arm (the single-track model); this
    angle is subtracted. None if the camera was stationary, untracked or turning fast.
    """
    past = motion.past
    steps = se3.inverse(past.world_from_cam[:-1]) @ past.world_from_cam[1:]
    lengths = np.linalg.norm(steps[:, :3, 3], axis=1)
    durations_s = np.diff(past.times_s)
    yaw_rates = np.array([se3.rotation_angle_rad(step) for step in steps]) / durations_s
    is_usable = (yaw_rates < np.radians(7)) & (lengths > 0.2 * lengths.max()) & motion.tracked[1:]
    if is_stationary(motion) or not is_usable.any():
        return None
    speed_m_s = slow_speed_m_s
    if past.is_metric:
        speed_m_s = float(np.median((lengths / durations_s)[is_usable]))
        if speed_m_s < min_speed_m_s:
            return None
    right, down, ahead = np.median(steps[is_usable, :3, 3] / lengths[is_usable, None], axis=0)
    angle_rad = np.arctan2(np.hypot(right, down), abs(ahead))
    turning_rad = np.arctan(lever_arm_m * np.median(yaw_rates[is_usable]) / speed_m_s)
    return float(np.degrees(max(0.0, angle_rad - turning_rad)))


def is_stationary(motion: Motion) -> bool:
    """Tell whether the camera never moved while it was observed."""
    return not np.ptp(motion.past.world_from_cam[:, :3, 3], axis=0).any()


def warnings(
    context: Context,
    motion: Motion,
    min_tracked_fraction: float = 0.7,
    max_off_axis_deg: float = 6.0,  # at most 2 on KITTI, straight ahead
) -> list[str]:
    """Return a sentence for each sign that the motion is wrong."""
    messages, tracked = [], motion.tracked
    if tracked.mean() < min_tracked_fraction:
        count = f"only {int(tracked.sum())} of {len(tracked)} observed frames could be tracked"
        messages.append(
            f"{count}: the motion is mostly a guess; give sharper frames or a larger --size"
        )
    angle_deg = off_axis_deg(motion)
    if angle_deg is not None and angle_deg > max_off_axis_deg:
        travels = f"the camera travels {angle_deg:.0f} degrees off its optical axis"
        messages.append(f"{travels}: unless it is mounted like that, the principal point is wrong")
    uncertainty = motion.past.scale_uncertainty or 0.0
    if uncertainty >= MIN_SPREAD:
        messages.append(
            "no road was found below the camera: scale from a prior of driving speeds, +- "
            f"{uncertainty:.0%}"
        )
    elif context.camera_height_m is not None and not motion.past.is_metric:
        messages.append(
            "no road was found below the camera, so lengths are not in metres in spite of "
            "--camera-height"
        )
    if is_stationary(motion):
        messages.append(
            "the camera is stationary, so the prediction is static and there is no cloud.ply"
        )
    return messages


def free_memory_bytes() -> float:
    """Return the available memory; infinite where the system does not state it."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return next(
            1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")
        )
    except (OSError, StopIteration):
        return np.inf
