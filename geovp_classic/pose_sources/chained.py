"""Odometry for the past, a forecaster for the future."""

from dataclasses import dataclass

from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.forecasting.selected import Selected
from geovp_classic.interfaces import Forecaster, Odometry
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.odometry.recorded_past import RecordedPast
from geovp_classic.types import Context, Motion, PrivilegedInput


@dataclass(frozen=True)
class Chained:
    """Odometry for the past, a forecaster for the future.

    The defaults need no recorded poses and were selected on `val`.
    """

    odometry: Odometry = Monocular()
    forecaster: Forecaster = MotionPrior()

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs of the odometry; a forecaster sees only poses."""
        return self.odometry.needs

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Return the tracked past and its forecast; one sample if all samples are equal."""
        past, tracked = self.odometry.track(context.only(self.odometry.needs))
        # Which forecaster is used is part of the result
        forecaster = self.forecaster
        if isinstance(forecaster, Selected):
            forecaster = forecaster.select(past)
        futures = forecaster.forecast(past, context.future_s, num_samples)
        if (futures == futures[0]).all():
            futures = futures[:1]
        return Motion(past, futures, tracked, forecaster)


class ContinuedRecording(Forecaster):
    """Pose source that continues the recorded past with the `forecast` of another base class."""

    needs = PrivilegedInput.PAST_POSES

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Return the recorded past and its continuation; raise Incompatible without poses."""
        return Chained(RecordedPast(), self).estimate(context, num_samples)
