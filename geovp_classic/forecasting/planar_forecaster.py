"""Base of the forecasters that predict motion on the vehicle's plane, and its distribution."""

import abc
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.body_motion import BodyForecast, BodyMotion
from geovp_classic.geometry import planar
from geovp_classic.types import FloatArray, Trajectory

Modes = tuple[FloatArray, FloatArray, FloatArray]  # weights [K], means, covariances


@dataclass(frozen=True)
class PlanarForecast:
    """A mixture of K Gaussians over (x, z, yaw_rad), in metres, on the last camera's plane."""

    weights: FloatArray  # [K], sum 1
    means: FloatArray  # [K, F, 3]
    covariances: FloatArray  # [K, F, 3, 3]
    world_from_reference: FloatArray  # [4, 4], the last observed camera
    vehicle_from_cam: FloatArray  # [4, 4]
    # None: height, pitch and roll do not change
    body: BodyForecast | None = None
    metres_per_unit: float = 1.0  # of the cameras' positions

    def states_of(self, world_from_cam: FloatArray) -> FloatArray:
        """Return (x, z, yaw_rad) [..., F, 3] of cameras [..., F, 4, 4]."""
        states = planar.reduce(world_from_cam, self.world_from_reference, self.vehicle_from_cam)
        states[..., :2] *= self.metres_per_unit
        return states

    def log_density(self, states: FloatArray) -> FloatArray:
        """Return the log density [N, F] per square metre and radian at states [N, F, 3]."""
        # Whitened errors: with the covariance L L', the density of an error e is that of inv(L) e
        # over the determinant of L
        error = states[None] - self.means[:, None]  # [K, N, F, 3]
        error[..., 2] = (error[..., 2] + np.pi) % (2 * np.pi) - np.pi
        root = np.linalg.cholesky(self.covariances)[:, None]  # [K, 1, F, 3, 3]
        white = (np.linalg.inv(root) @ error[..., None])[..., 0]
        log_root_determinant = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(-1)
        log_volume = log_root_determinant + 1.5 * np.log(2 * np.pi)
        log_densities = -0.5 * (white**2).sum(-1) - log_volume  # [K, N, F]
        # The mixture of the modes; one may have become so unlikely that its weight is 0
        log_weights = np.log(np.maximum(self.weights, np.finfo(float).tiny))
        return logsumexp(log_densities + log_weights[:, None, None], axis=0)

    def sample(
        self,
        num_samples: int,
        seed: int,
    ) -> FloatArray:
        """Draw states [N, F, 3], independent from step to step."""
        rng = np.random.default_rng(seed)
        modes = rng.choice(len(self.weights), size=num_samples, p=self.weights)
        roots = np.linalg.cholesky(self.covariances)[modes]
        white = rng.standard_normal((*roots.shape[:2], 3))
        return self.means[modes] + (roots @ white[..., None])[..., 0]


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
        ahead_s: FloatArray,  # [F]
        num_samples: int,
    ) -> FloatArray:
        """Return the central path [1, F, 3], or several samples [S, F, 3], after a metric past."""

    @abc.abstractmethod
    def modes(
        self,
        past: Trajectory,
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
        paths = self.paths(metric, ahead_s, num_samples)
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
        modes = self.modes(metric, ahead_s)
        body = None
        if self.body_motion is not None and len(past) > 1:
            body = self.body_motion.distribution(metric, times_s)
        return PlanarForecast(*modes, past.world_from_cam[-1], plane, body, metres_per_unit)
