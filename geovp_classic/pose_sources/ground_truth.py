"""The recorded motion, past and future."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.odometry.recorded import recorded
from geovp_classic.types import Context, Motion, PrivilegedInput


@dataclass(frozen=True)
class GroundTruth:
    """The recorded motion in 3D, past and future: the perfect pose source (GT-3D)."""

    needs = (
        PrivilegedInput.PAST_POSES | PrivilegedInput.FUTURE_POSES
    )  # the recorded poses of past and future

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The recorded motion, one sample; Incompatible when the clip has no poses."""
        past, future = recorded(context.past, "past"), recorded(context.future, "future")
        return Motion(past, future.world_from_cam[None], np.ones(len(past), dtype=bool))
