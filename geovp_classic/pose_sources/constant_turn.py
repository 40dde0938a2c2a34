"""The recorded past, continued at the mean SE(3) twist of its last `num_steps` steps."""

from typing import ClassVar

from geovp_classic.forecasting import constant
from geovp_classic.odometry.recorded import Recorded
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.types import Context, Motion, PrivilegedInput


class ConstantTurn(constant.ConstantTurn):
    """The recorded past, continued at the mean SE(3) twist of its last `num_steps` steps."""

    needs: ClassVar[PrivilegedInput] = PrivilegedInput.PAST_POSES

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Return the recorded past and its continuation, one sample; raise Incompatible without
        poses.
        """
        return Chained(Recorded(), self).estimate(context, num_samples)
