"""What past poses tell of the camera's motion: the pitch of its plane, its scale, its twists on an
even time grid.
"""

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray, Trajectory

STANDING_M = 0.5  # a past shorter than this says little about the road's pitch
SCALE_FREE_SPEED_M_S = 9.0  # assumed of a past without metres: about the median of the train poses


def seconds_ahead(past: Trajectory, times_s: FloatArray) -> FloatArray:
    """The future times [F], counted from the last past pose; BadData unless all are finite and
    later than it.
    """
    if len(past) == 0:
        raise BadData("a forecast from no past pose at all: give it at least one")
    ahead_s = np.asarray(times_s, dtype=np.float64) - past.times_s[-1]
    if ahead_s.ndim != 1 or not np.isfinite(ahead_s).all() or (ahead_s <= 0).any():
        raise BadData(
            "a future time is not later than the last past pose: give finite times after it, "
            "one per step"
        )
    return ahead_s


def in_metres(past: Trajectory) -> tuple[Trajectory, float]:
    """The past in metres, and metres per unit; without metres its mean speed is taken as
    SCALE_FREE_SPEED_M_S.
    """
    path = np.linalg.norm(np.diff(past.world_from_cam[:, :3, 3], axis=0), axis=-1).sum()
    if past.is_metric or path == 0:
        return past, 1.0
    metres_per_unit = float(SCALE_FREE_SPEED_M_S * (past.times_s[-1] - past.times_s[0]) / path)
    world_from_cam = past.world_from_cam.copy()
    world_from_cam[:, :3, 3] *= metres_per_unit
    return Trajectory(world_from_cam, past.times_s, is_metric=True), metres_per_unit


def vehicle_from_cam(past: Trajectory) -> FloatArray:
    """The plane [4, 4] that the past motion suggests: pitched so that the camera has been
    travelling along it.

    The pitch is a regression of the vertical on the forward velocity, drawn to 0 when the past is
    shorter than about STANDING_M, and at most ten degrees.
    """
    steps = se3.inverse(past.world_from_cam[:-1]) @ past.world_from_cam[1:]
    down, forward = steps[:, 1, 3].sum(), steps[:, 2, 3].sum()
    slope = down * forward / (forward**2 + STANDING_M**2)
    limit = np.tan(np.radians(10.0))
    return planar.level_vehicle_from_cam(pitch_rad=float(np.arctan(np.clip(slope, -limit, limit))))


def poses_at(trajectory: Trajectory, times_s: FloatArray) -> FloatArray:
    """world_from_cam [T, 4, 4] between the poses, and beyond them on the first or the last step's
    screw motion.
    """
    after = np.clip(
        np.searchsorted(trajectory.times_s, times_s, side="right"), 1, len(trajectory) - 1
    )
    before_s, after_s = trajectory.times_s[after - 1], trajectory.times_s[after]
    share = (times_s - before_s) / (after_s - before_s)
    return se3.interpolate(
        trajectory.world_from_cam[after - 1], trajectory.world_from_cam[after], share
    )


def twists_per_s(past: Trajectory, step_s: float, num_steps: int) -> FloatArray:
    """Twists per second [num_steps, 6] = (v, w) of the camera in its own frame, on an even grid up
    to the last pose.

    Where the grid begins before the past does, its earliest known step is repeated; at least two
    poses are needed.
    """
    span_s = past.times_s[-1] - past.times_s[0]
    known = int(
        np.clip(np.floor(span_s / step_s + 0.1), 1, num_steps)
    )  # a tenth of a step may be extrapolated
    poses = poses_at(past, past.times_s[-1] - step_s * np.arange(known, -1, -1))
    twists = se3.log(se3.inverse(poses[:-1]) @ poses[1:]) / step_s
    return np.concatenate([np.repeat(twists[:1], num_steps - known, axis=0), twists])
