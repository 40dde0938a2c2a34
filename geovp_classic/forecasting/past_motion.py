"""Motion of the past poses: the vehicle's plane, the metric scale, and twists on an even grid."""

import enum

import numpy as np

from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray, Trajectory
from geovp_classic.types.speed_prior import SpeedPrior


class Axis(enum.IntEnum):
    """Components of a twist (v, w) in the camera's frame; positive pitch looks up."""

    RIGHT, DOWN, FORWARD, PITCH, YAW, ROLL = range(6)


def in_metres(
    past: Trajectory,
    assumed_speed_m_s: float = SpeedPrior.median_m_s,
) -> tuple[Trajectory, float]:
    """Return the past in metres, and metres per unit of the given past.

    Without metric scale the mean speed is assumed.
    """
    length = se3.step_lengths(past.world_from_cam).sum()
    if past.is_metric or length == 0:
        return past, 1.0
    duration_s = past.times_s[-1] - past.times_s[0]
    metres_per_unit = assumed_speed_m_s * duration_s / length
    world_from_cam = past.world_from_cam.copy()
    world_from_cam[:, :3, 3] *= metres_per_unit
    return Trajectory(world_from_cam, past.times_s, True), metres_per_unit


def vehicle_from_cam(
    past: Trajectory,
    # The pitch of a shorter path is drawn to 0: 1 cm of noise on it is a pitch of 1 degree.
    min_path_m: float = 0.5,
    max_pitch_deg: float = 10.0,  # of a camera that shows the road; steeper paths are errors
) -> FloatArray:
    """Return the plane [4, 4] along which the camera has travelled.

    Its pitch is a regression of vertical on forward motion, regularised by `min_path_m`.
    """
    steps = se3.steps(past.world_from_cam)
    _, down, forward = steps[:, :3, 3].sum(axis=0)
    pitch_rad = np.arctan(down * forward / (forward**2 + min_path_m**2))
    max_pitch_rad = np.radians(max_pitch_deg)
    return planar.level_vehicle_from_cam(np.clip(pitch_rad, -max_pitch_rad, max_pitch_rad))


def twists_per_s(
    past: Trajectory,
    step_s: float,
    num_steps: int,
) -> FloatArray:
    """Return twists per second [num_steps, 6] on an even grid that ends at the last of >= 2 poses.

    The first twist is repeated where the grid begins before the past.
    """
    span_s = past.times_s[-1] - past.times_s[0]
    # Steps are up to a tenth shorter, as times of cameras jitter, or as short as a short past
    num_covered = int(np.clip(np.floor(span_s / step_s + 0.1), 1, num_steps))
    step_s = min(step_s, span_s / num_covered)
    grid_s = past.times_s[-1] - step_s * np.arange(num_covered, -1, -1)
    poses = se3.interpolate(past.world_from_cam, past.times_s, grid_s)
    twists = se3.log(se3.steps(poses)) / step_s
    missing = np.repeat(twists[:1], num_steps - num_covered, axis=0)
    return np.concatenate([missing, twists])
