"""What past poses say about how the camera moves: the pitch of its road, its unit, its velocity on an even grid."""

from __future__ import annotations

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray, Trajectory

STANDING_M = 0.5  # a past shorter than this says little about the road's pitch


def seconds_ahead(past: Trajectory, times_s: FloatArray) -> FloatArray:
    """The future times [F], counted from the last past pose; BadData unless all are finite and later than it."""
    if len(past) == 0:
        raise BadData("a forecast from no past pose at all: give it at least one")
    ahead_s = np.asarray(times_s, dtype=np.float64) - past.times_s[-1]
    if ahead_s.ndim != 1 or not np.isfinite(ahead_s).all() or (ahead_s <= 0).any():
        raise BadData("a future time is not later than the last past pose: give finite times after it, one per step")
    return ahead_s


def metres_per_unit(past: Trajectory, assumed_speed_m_s: float) -> float:
    """1 for a metric past; otherwise what makes its mean speed the assumed one (1 when it stands still)."""
    if past.is_metric or len(past) < 2:
        return 1.0
    path = np.linalg.norm(np.diff(past.world_from_cam[:, :3, 3], axis=0), axis=-1).sum()
    duration_s = past.times_s[-1] - past.times_s[0]
    return float(assumed_speed_m_s * duration_s / path) if path > 0 else 1.0


def scaled(past: Trajectory, factor: float) -> Trajectory:
    """The same motion with lengths multiplied by the factor, in metres."""
    world_from_cam = past.world_from_cam.copy()
    world_from_cam[:, :3, 3] *= factor
    return Trajectory(world_from_cam, past.times_s, is_metric=True)


def vehicle_from_cam(past: Trajectory) -> FloatArray:
    """The plane [4, 4] that the past motion suggests: pitched so that the camera has been travelling along it.

    The pitch is a regression of the vertical on the forward velocity, drawn to 0 when the past is shorter than about
    STANDING_M, and at most ten degrees.
    """
    steps = se3.inverse(past.world_from_cam[:-1]) @ past.world_from_cam[1:]
    down, forward = steps[:, 1, 3].sum(), steps[:, 2, 3].sum()
    slope = down * forward / (forward**2 + STANDING_M**2)
    limit = np.tan(np.radians(10.0))
    return planar.level_vehicle_from_cam(pitch_rad=float(np.arctan(np.clip(slope, -limit, limit))))


def body_rates(past: Trajectory, step_s: float, num_steps: int) -> FloatArray:
    """Twists per second [num_steps, 6] = (v, w) of the camera in its own frame, on an even grid up to the last pose.

    Where the grid begins before the past does, its earliest known step is repeated; at least two poses are needed.
    """
    grid_s = past.times_s[-1] - step_s * np.arange(num_steps, -1, -1)
    span_s = past.times_s[-1] - past.times_s[0]
    known = int(np.clip(np.floor(span_s / step_s + 0.1), 1, num_steps))  # a tenth of a step may be extrapolated
    grid_s = grid_s[num_steps - known :]
    after = np.clip(np.searchsorted(past.times_s, grid_s, side="right"), 1, len(past) - 1)
    before_s, after_s = past.times_s[after - 1], past.times_s[after]
    poses = se3.interpolate(
        past.world_from_cam[after - 1], past.world_from_cam[after], (grid_s - before_s) / (after_s - before_s)
    )
    rates = se3.log(se3.inverse(poses[:-1]) @ poses[1:]) / step_s
    return np.concatenate([np.repeat(rates[:1], num_steps - known, axis=0), rates])
