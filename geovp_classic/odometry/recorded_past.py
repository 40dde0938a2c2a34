"""Recorded past poses as an odometry without error."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import Incompatible
from geovp_classic.types import BoolArray, Context, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class RecordedPast:
    """The recorded past poses, as an odometry without error."""

    needs = PrivilegedInput.PAST_POSES  # the recorded past poses

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """Return the recorded past [P], all tracked; raise Incompatible without poses."""
        past = recorded(context.past, "past")
        return past, np.ones(len(past), bool)


def recorded(trajectory: Trajectory | None, which: str) -> Trajectory:
    """Return the recorded poses; raise Incompatible if the clip has none."""
    if trajectory is None:
        raise Incompatible(
            f"this pose source needs recorded {which} poses, the clip has none: choose an odometry"
        )
    return trajectory
