"""What the true trajectory says about a clip's future: how far it turns, how fast it goes."""

import numpy as np

from geovp_classic.geometry import planar
from geovp_classic.types import Context, Target


def clip_facts(context: Context, target: Target) -> dict[str, float]:
    """Numbers by name, {} for a clip without poses; `context` needs every grant.

    `yaw_deg`: the largest change of heading within the future, against the last observed camera and
    in its x-z plane, either way; `speed_m_s` and `step_m`: the mean over the future, absent where
    poses are not metric.
    """
    past, future = context.past, target.trajectory
    if past is None or future is None:
        return {}
    path = past[-1:].then(future)
    states = planar.reduce(
        path.world_from_cam, path.world_from_cam[0], planar.level_vehicle_from_cam()
    )
    facts = {"yaw_deg": float(np.rad2deg(np.abs(np.unwrap(states[:, 2])).max()))}
    if path.is_metric:
        length_m = float(
            np.linalg.norm(np.diff(path.world_from_cam[:, :3, 3], axis=0), axis=1).sum()
        )
        facts["speed_m_s"] = length_m / float(path.times_s[-1] - path.times_s[0])
        facts["step_m"] = length_m / len(future)
    return facts
