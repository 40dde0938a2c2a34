"""The recorded past, after which the camera stays where it is."""

from typing import ClassVar

from geovp_classic.forecasting import constant
from geovp_classic.odometry.recorded import Recorded
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.types import Context, Motion, PrivilegedInput


class StandStill(constant.Hold):
    """The recorded past, after which the camera stays where it is."""

    needs: ClassVar[PrivilegedInput] = PrivilegedInput.PAST_POSES

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Return the recorded past and its continuation, one sample; raise Incompatible without
        poses.
        """
        return Chained(Recorded(), self).estimate(context, num_samples)
