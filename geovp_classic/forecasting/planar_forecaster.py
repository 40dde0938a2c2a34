"""Base of the forecasters that predict motion on the vehicle's plane."""

import abc
from dataclasses import dataclass

from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.body_motion import BodyMotion
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.geometry import planar
from geovp_classic.types import FloatArray, Trajectory

Modes = tuple[
    FloatArray, FloatArray, FloatArray
]  # weights [K], means, covariances


@dataclass(frozen=True)
class PlanarForecaster(abc.ABC):
    """Forecaster of (x, z, yaw) in metres on the plane along which the camera has travelled."""

    seed: int = 0
    # None: height, pitch and roll over the plane do not change
    body_motion: BodyMotion | None = BodyMotion()

    @abc.abstractmethod
    def paths(
        self,
        past: Trajectory,
        plane: FloatArray,  # [4, 4], vehicle_from_cam
        ahead_s: FloatArray,  # [F]
        num_samples: int,
    ) -> FloatArray:
        """Return the central path [1, F, 3], or several samples [S, F, 3], after a metric past."""

    @abc.abstractmethod
    def modes(
        self,
        past: Trajectory,
        plane: FloatArray,  # [4, 4], vehicle_from_cam
        ahead_s: FloatArray,  # [F]
    ) -> Modes:
        """Return the weights, means [K, F, 3] and covariances [K, F, 3, 3] of a mixture."""

    def forecast(
        self,
        past: Trajectory,
        times_s: FloatArray,  # [F]
        num_samples: int = 1,
    ) -> FloatArray:
        """Return futures [S, F, 4, 4]: the central path if one is asked for, otherwise samples."""
        ahead_s = times_s - past.times_s[-1]
        metric, metres_per_unit = past_motion.in_metres(past)
        plane = past_motion.vehicle_from_cam(metric)
        paths = self.paths(metric, plane, ahead_s, num_samples)
        futures = planar.lift(paths, metric.world_from_cam[-1], plane)
        if self.body_motion is not None:
            futures = self.body_motion.added_to(futures, metric, times_s)
        futures[..., :3, 3] /= metres_per_unit
        return futures

    def distribution(
        self,
        past: Trajectory,
        times_s: FloatArray,  # [F]
    ) -> PlanarForecast:
        """Return the predictive distribution at every future time."""
        ahead_s = times_s - past.times_s[-1]
        metric, metres_per_unit = past_motion.in_metres(past)
        plane = past_motion.vehicle_from_cam(metric)
        modes = self.modes(metric, plane, ahead_s)
        body = None
        if self.body_motion is not None and len(past) > 1:
            body = self.body_motion.distribution(metric, times_s)
        return PlanarForecast(
            *modes, past.world_from_cam[-1], plane, body, metres_per_unit
        )
