"""The recorded past, continued at a constant twist."""

from geovp_classic.forecasting import constant
from geovp_classic.pose_sources.chained import ContinuedRecording


class ConstantTurn(constant.ConstantTurn, ContinuedRecording):
    """The recorded past, continued at the mean SE(3) twist of its last `num_steps` steps."""
