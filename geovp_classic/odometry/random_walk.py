"""Random walk through noisy measurements, among outliers."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class RandomWalk:
    """Smoothing with noise and steps that are estimated from the measurements.

    Measurements have Student-t noise. Its size, and that of the steps, are estimated by
    expectation maximisation (Shumway & Stoffer 1982), with their defaults as prior.
    """

    step: float = 0.002  # default standard deviation of a step
    prior_weight: float = 20.0  # measurements that the defaults count for
    degrees_of_freedom: float = 4.0  # of Student's distribution
    # of the first round's step, which only shrinks slowly
    start_ratio: float = 10.0
    num_rounds: int = 15

    def smooth(
        self,
        measured: FloatArray,  # [N]; NaN: not measured
        deviation: FloatArray,  # [N], default standard deviations
        step_ratio: FloatArray,  # [N], steps to each value, relative; inf: unrelated values
    ) -> tuple[FloatArray, FloatArray]:
        """Return the values [N] of the walk and their standard deviations [N]."""
        is_measured = np.isfinite(measured)
        measured = np.nan_to_num(measured)
        precision = np.where(is_measured, 1 / deviation**2, 0.0)
        step_ratio2 = step_ratio[1:] ** 2
        is_related = np.isfinite(step_ratio2)
        weight = np.ones(len(measured))
        noise2 = 1.0
        step2 = (self.start_ratio * self.step) ** 2
        for _ in range(self.num_rounds):
            information = weight * precision / noise2
            mean, covariance = _solve(measured, information, 1 / (step2 * step_ratio2))
            variance = np.diag(covariance)
            error2 = ((measured - mean) ** 2 + variance) * precision
            noise2 = max(1.0, self._update(1.0, (weight * error2)[is_measured]))
            weight = (self.degrees_of_freedom + 1) / (self.degrees_of_freedom + error2 / noise2)
            moved2 = np.diff(mean) ** 2 + variance[1:] + variance[:-1]
            moved2 -= 2 * np.diag(covariance, 1)
            step2 = self._update(self.step**2, (moved2 / step_ratio2)[is_related])
        return mean, np.sqrt(variance)

    def _update(self, default: float, squares: FloatArray) -> float:
        """Return the mean of squares [M], and of the default with its weight."""
        total = self.prior_weight * default + squares.sum()
        return float(total / (self.prior_weight + len(squares)))


def _solve(
    measured: FloatArray,  # [N]
    information: FloatArray,  # [N], of the measurements
    step_information: FloatArray,  # [N - 1]
) -> tuple[FloatArray, FloatArray]:
    """Return the mean [N] and the covariance [N, N] of a random walk with Gaussian noise."""
    # An empty second diagonal avoids SciPy's solver that fails for a single value.
    bands = np.zeros((3, len(measured)))
    bands[1, 1:] = -step_information
    bands[2] = information + 1e-6  # for a walk without measurements
    bands[2, 1:] += step_information
    bands[2, :-1] += step_information
    covariance = solveh_banded(bands, np.eye(len(measured)))
    return covariance @ (information * measured), covariance
