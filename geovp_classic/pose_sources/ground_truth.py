"""The recorded motion, past and future."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.odometry.recorded_past import recorded
from geovp_classic.types import Context, Motion, PrivilegedInput


@dataclass(frozen=True)
class GroundTruth:
    """The recorded motion in 3D, past and future (GT-3D)."""

    needs = PrivilegedInput.PAST_POSES | PrivilegedInput.FUTURE_POSES

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Return the recorded motion, one sample; raise Incompatible without poses."""
        past = recorded(context.past, "past")
        future = recorded(context.future, "future")
        tracked = np.ones(len(past), bool)
        return Motion(past, future.world_from_cam[None], tracked)
