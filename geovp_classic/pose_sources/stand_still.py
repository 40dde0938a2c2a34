"""The recorded past, after which the camera is stationary."""

from geovp_classic.forecasting.constant import Hold
from geovp_classic.pose_sources.chained import ContinuedRecording


class StandStill(Hold, ContinuedRecording):
    """The recorded past, after which the camera is stationary."""
