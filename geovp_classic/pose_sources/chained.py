"""Odometry for the past, a forecaster for the future."""

from dataclasses import dataclass, field

from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.interfaces import Forecaster, Odometry
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.types import Context, Motion, PrivilegedInput


@dataclass(frozen=True)
class Chained:
    """Odometry for the past, a forecaster for the future; the defaults use no recorded pose and won
    on `val`.
    """

    odometry: Odometry = field(default_factory=Monocular)
    forecaster: Forecaster = field(default_factory=MotionPrior)

    @property
    def needs(self) -> PrivilegedInput:
        """What the odometry needs; a forecaster sees nothing but poses."""
        return self.odometry.needs

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The tracked past and its forecast; one sample when all samples are the same."""
        past, tracked = self.odometry.track(context.only(self.odometry.needs))
        futures = self.forecaster.forecast(past, context.times_s[context.num_past :], num_samples)
        same = (futures == futures[:1]).all()
        return Motion(past, futures[:1] if same else futures, tracked)
