"""Kernels of Gaussian processes for a vehicle's angles over time (Rasmussen & Williams 2006)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geovp_classic.types import FloatArray

# Covariance of two angles, up to a constant, as a function of the seconds between them.
Kernel = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Matern52:
    """Matern kernel with nu = 5/2 for angles that return to their mean (eq. 4.17)."""

    deviation_rad: float
    time_constant_s: float

    def __call__(self, apart_s: FloatArray) -> FloatArray:
        """Return the covariances [...] in rad^2."""
        ratio = np.sqrt(5) * np.abs(apart_s) / self.time_constant_s
        return np.asarray(
            self.deviation_rad**2 * (1 + ratio + ratio**2 / 3) * np.exp(-ratio)
        )


@dataclass(frozen=True)
class IntegratedOrnsteinUhlenbeck:
    """Angles with an Ornstein-Uhlenbeck process as their rate: minus half the variance of their
    increment.
    """

    deviation_rad_s: float
    time_constant_s: float

    def __call__(self, apart_s: FloatArray) -> FloatArray:
        """Return the covariances [...] in rad^2."""
        ratio = np.abs(apart_s) / self.time_constant_s
        deviation_rad = self.deviation_rad_s * self.time_constant_s
        return np.asarray(-(deviation_rad**2) * (ratio + np.expm1(-ratio)))


def covariance_of_differences(
    kernel: Kernel,
    a_s: FloatArray,  # [N]
    a_from_s: FloatArray | float,  # [N]
    b_s: FloatArray,  # [M]
    b_from_s: FloatArray | float,  # [M]
) -> FloatArray:
    """Return the covariance [N, M] of angle(a) - angle(a_from) and angle(b) - angle(b_from)."""
    a_from = np.broadcast_to(a_from_s, a_s.shape)
    b_from = np.broadcast_to(b_from_s, b_s.shape)
    ends = kernel(np.subtract.outer(a_s, b_s)) + kernel(
        np.subtract.outer(a_from, b_from)
    )
    mixed = kernel(np.subtract.outer(a_s, b_from)) + kernel(
        np.subtract.outer(a_from, b_s)
    )
    return np.asarray(ends - mixed)
