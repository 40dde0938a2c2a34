"""Student's t, without scipy.special, whose import takes longer than the rest of a table."""

import functools
import math

import numpy as np

from geovp_classic.types import FloatArray


@functools.lru_cache(maxsize=1024)
def student_quantile(degrees: float, fraction: float) -> float:
    """Return the quantile of Student's t at a fraction above 1/2.

    It is sqrt(degrees) tan(angle), where the density of the angle is cos(angle)^(degrees - 1).
    """
    angles_rad, mass = _student(degrees)
    angle_rad = np.interp(2 * fraction - 1, mass, angles_rad)
    return float(np.sqrt(degrees) * np.tan(angle_rad))


def student_p_value(mean: float, error: float, degrees: float) -> float:
    """Return the two-sided p-value of Student's test that the mean is zero."""
    if not error:
        return 1.0 if not mean else 0.0
    angles_rad, mass = _student(degrees)
    angle_rad = math.atan(abs(mean) / error / math.sqrt(degrees))
    return float(1 - np.interp(angle_rad, angles_rad, mass))


@functools.lru_cache(maxsize=64)
def _student(degrees: float) -> tuple[FloatArray, FloatArray]:
    """Return angles up to pi / 2, and the mass of Student's t between minus and plus each."""
    angles_rad = np.linspace(0, np.pi / 2, 20001)
    middles_rad = (angles_rad[1:] + angles_rad[:-1]) / 2
    mass = np.concatenate([[0.0], np.cumsum(np.cos(middles_rad) ** (degrees - 1))])
    return angles_rad, mass / mass[-1]
