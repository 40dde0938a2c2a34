"""The distribution of a forecast: a Gaussian mixture over (x, z, yaw), and Student's t of heave,
pitch and roll.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp, stdtr

from geovp_classic.geometry import planar
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class BodyForecast:
    """Heave (m, downwards), pitch and roll (rad) over the plane at every future time, independent
    of each other.
    """

    means: FloatArray  # [F, 3]
    scales: FloatArray  # [F, 3], of Student's t
    degrees: FloatArray  # [3], of freedom

    def log_density(self, states: FloatArray) -> FloatArray:
        """Log density [N, F] at states [N, F, 3]."""
        from scipy import stats  # half a second that no forecast needs

        return np.asarray(
            stats.t.logpdf(states, self.degrees, self.means, self.scales).sum(axis=-1)
        )

    def ranks(self, states: FloatArray) -> FloatArray:
        """Probability [F, 3] of the central interval that each of the states [F, 3] bounds."""
        return np.asarray(2 * stdtr(self.degrees, np.abs(states - self.means) / self.scales) - 1)

    def sample(self, num_samples: int, seed: int) -> FloatArray:
        """States [N, F, 3], independent from step to step."""
        drawn = np.random.default_rng(seed).standard_t(
            self.degrees, (num_samples, *self.means.shape)
        )
        return self.means + self.scales * drawn


@dataclass(frozen=True)
class PlanarForecast:
    """K modes of (x, z, yaw_rad) on the plane of the last observed camera; one mode for a Kalman
    filter.
    """

    weights: FloatArray  # [K], sum 1
    means: FloatArray  # [K, F, 3]
    covariances: FloatArray  # [K, F, 3, 3]
    world_from_reference: FloatArray  # [4, 4], the last observed camera
    vehicle_from_cam: FloatArray  # [4, 4]
    body: BodyForecast | None = (
        None  # what is over the plane, independent of the motion on it; None: nothing moves
    )

    def states_of(self, world_from_cam: FloatArray) -> FloatArray:
        """(x, z, yaw_rad) [..., F, 3] of cameras [..., F, 4, 4] on this forecast's plane."""
        return planar.reduce(world_from_cam, self.world_from_reference, self.vehicle_from_cam)

    def log_density(self, states: FloatArray) -> FloatArray:
        """Log density [N, F] (per square metre and radian) at states [N, F, 3]; yaw differences are
        wrapped.
        """
        error = states[None] - self.means[:, None]  # [K, N, F, 3]
        error[..., 2] = (error[..., 2] + np.pi) % (2 * np.pi) - np.pi
        lower = np.linalg.cholesky(self.covariances)[:, None]  # [K, 1, F, 3, 3]
        white = (np.linalg.inv(lower) @ error[..., None])[..., 0]  # one inverse serves all N
        log_volume = np.log(np.diagonal(lower, axis1=-2, axis2=-1)).sum(-1) + 1.5 * np.log(
            2 * np.pi
        )
        with np.errstate(divide="ignore"):
            log_weights = np.log(self.weights)[:, None, None]
        return np.asarray(logsumexp(log_weights - 0.5 * (white**2).sum(-1) - log_volume, axis=0))

    def sample(self, num_samples: int, seed: int) -> FloatArray:
        """States [N, F, 3], independent from step to step (unlike the paths that a forecaster
        draws).
        """
        rng = np.random.default_rng(seed)
        modes = rng.choice(len(self.weights), size=num_samples, p=self.weights)
        lower = np.linalg.cholesky(self.covariances)[modes]
        white = rng.standard_normal((*lower.shape[:2], 3))
        return self.means[modes] + (lower @ white[..., None])[..., 0]
