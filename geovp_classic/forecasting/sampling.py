"""Distributions of a forecast: a Gaussian mixture over (x, z, yaw), Student's t for the body."""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp, stdtr

from geovp_classic.geometry import planar
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class BodyForecast:
    """Heave (m, downwards), pitch and roll (rad) over the plane; all are independent."""

    means: FloatArray  # [F, 3]
    scales: FloatArray  # [F, 3], of Student's t
    degrees: FloatArray  # [3], of freedom

    def log_density(self, states: FloatArray) -> FloatArray:
        """Return the log density [N, F] at states [N, F, 3]."""
        from scipy import stats  # takes half a second to import

        density = stats.t.logpdf(states, self.degrees, self.means, self.scales)
        return density.sum(axis=-1)

    def ranks(self, states: FloatArray) -> FloatArray:
        """Return the probability [F, 3] of the central interval that ends at each state [F, 3]."""
        distance = np.abs(states - self.means) / self.scales
        return 2 * stdtr(self.degrees, distance) - 1

    def sample(
        self,
        num_samples: int,
        seed: int,
    ) -> FloatArray:
        """Draw states [N, F, 3], independent from step to step."""
        rng = np.random.default_rng(seed)
        drawn = rng.standard_t(self.degrees, (num_samples, *self.means.shape))
        return self.means + self.scales * drawn


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
        states = planar.reduce(
            world_from_cam, self.world_from_reference, self.vehicle_from_cam
        )
        states[..., :2] *= self.metres_per_unit
        return states

    def log_density(self, states: FloatArray) -> FloatArray:
        """Return the log density [N, F] per square metre and radian at states [N, F, 3]."""
        error = states[None] - self.means[:, None]  # [K, N, F, 3]
        error[..., 2] = (error[..., 2] + np.pi) % (2 * np.pi) - np.pi
        root = np.linalg.cholesky(self.covariances)[:, None]  # [K, 1, F, 3, 3]
        white = (np.linalg.inv(root) @ error[..., None])[..., 0]
        log_root_determinant = np.log(
            np.diagonal(root, axis1=-2, axis2=-1)
        ).sum(-1)
        log_volume = log_root_determinant + 1.5 * np.log(2 * np.pi)
        log_densities = -0.5 * (white**2).sum(-1) - log_volume  # [K, N, F]
        return logsumexp(log_densities, axis=0, b=self.weights[:, None, None])

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
