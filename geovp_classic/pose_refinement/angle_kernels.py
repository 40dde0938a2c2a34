"""Kernels of Gaussian processes for a vehicle's angles over time (Rasmussen & Williams 2006)."""

from collections.abc import Callable

import numpy as np

from geovp_classic.types import FloatArray

Kernel = Callable[
    [FloatArray], FloatArray
]  # covariance of angles as a function of their distance in seconds, up to a constant


def matern52(deviation_rad: float, time_constant_s: float) -> Kernel:
    """Matern kernel with nu = 5/2 for angles that return to their mean (Rasmussen & Williams 2006,
    eq. 4.17).
    """

    def covariance(apart_s: FloatArray) -> FloatArray:
        far = np.sqrt(5) * np.abs(apart_s) / time_constant_s
        return np.asarray(deviation_rad**2 * (1 + far + far**2 / 3) * np.exp(-far))

    return covariance


def integrated_ornstein_uhlenbeck(deviation_rad_s: float, time_constant_s: float) -> Kernel:
    """Angles whose rate is an Ornstein-Uhlenbeck process: minus half the variance of their
    increment.
    """

    def covariance(apart_s: FloatArray) -> FloatArray:
        lasts = np.abs(apart_s) / time_constant_s
        return np.asarray(-((deviation_rad_s * time_constant_s) ** 2) * (lasts + np.expm1(-lasts)))

    return covariance


def covariance_of_differences(
    kernel: Kernel,
    one_s: FloatArray,  # [N]
    one_from_s: FloatArray | float,  # [N]
    other_s: FloatArray,  # [M]
    other_from_s: FloatArray | float,  # [M]
) -> FloatArray:
    """Covariance [N, M] of angle(one_s) - angle(one_from_s) and angle(other_s) -
    angle(other_from_s).
    """
    ones = one_s, np.broadcast_to(one_from_s, one_s.shape)
    others = other_s, np.broadcast_to(other_from_s, other_s.shape)
    (to_to, to_from), (from_to, from_from) = (
        [kernel(one[:, None] - other) for other in others] for one in ones
    )
    return np.asarray(to_to - to_from - from_to + from_from)
