"""The recorded past, continued at constant velocity."""

from geovp_classic.forecasting import constant
from geovp_classic.pose_sources.chained import ContinuedRecording


class ConstantVelocity(constant.ConstantVelocity, ContinuedRecording):
    """The recorded past, continued at the mean velocity of its last `num_steps` steps."""
