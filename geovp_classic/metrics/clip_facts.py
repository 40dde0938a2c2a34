"""Attributes of a clip's future: how far the camera turns and how fast it moves."""

import numpy as np

from geovp_classic.geometry import planar, se3
from geovp_classic.types import Context, Target


def clip_facts(context: Context, target: Target) -> dict[str, float]:
    """Return numbers by name, {} for a clip without poses.

    `yaw_deg` is the largest change of heading in the future, relative to the last observed camera
    and in its x-z plane. `speed_m_s` and `step_m` are means over the future; they need metric
    poses. `context` needs all privileged inputs.
    """
    past = context.past
    future = target.trajectory
    if past is None or future is None:
        return {}
    poses = np.concatenate([past.world_from_cam[-1:], future.world_from_cam])
    states = planar.reduce(poses, poses[0], planar.level_vehicle_from_cam())
    yaw_rad = np.unwrap(states[:, 2])
    facts = {"yaw_deg": float(np.rad2deg(np.abs(yaw_rad).max()))}
    if future.is_metric:
        steps_m = se3.step_lengths(poses)
        duration_s = future.times_s[-1] - past.times_s[-1]
        facts["speed_m_s"] = float(steps_m.sum() / duration_s)
        facts["step_m"] = float(steps_m.mean())
    return facts
