"""Calibration of the prior's predictive regions on roads that it was not fitted to.

The regions at one horizon are resized by a common factor, as in split conformal prediction (Vovk
et al. 2005; Romano et al. 2019). Windows of one sequence are far from independent, so sequences
weigh equally.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from geovp_benchmarks.fitting.training_windows import TrainingWindows
from geovp_classic.forecasting import motion_prior
from geovp_classic.forecasting.motion_network import Coefficients
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.types import BoolArray, FloatArray

# Pieces of one sequence, each with a fit to other pieces.
HeldOut = Sequence[tuple[Coefficients, TrainingWindows]]


@dataclass(frozen=True)
class Calibration:
    """Settings of the calibration."""

    target: float = 0.9  # coverage of the regions
    choices: FloatArray = field(default_factory=lambda: np.geomspace(0.4, 2.5, 41))  # of the factor
    num_samples: int = 400
    stride: int = 5  # between windows, since neighbours are alike

    def factors(self, sequences: Iterable[HeldOut]) -> FloatArray:
        """Return the factor [F] by which the region at each step is to be resized."""
        curves = []
        for pieces in sequences:
            coverages = [self.coverage(fitted, windows) for fitted, windows in pieces]
            lengths = [len(windows) for _, windows in pieces]
            curves.append(np.average(coverages, axis=0, weights=lengths))
        increasing = np.maximum.accumulate(np.mean(curves, axis=0))  # [choices, F]
        return np.array([np.interp(self.target, curve, self.choices) for curve in increasing.T])

    def coverage(
        self,
        fitted: Coefficients,
        windows: TrainingWindows,
    ) -> FloatArray:
        """Return the fraction [choices, F] of true states inside the resized regions."""
        selected = range(0, len(windows), self.stride)
        covered = [self._is_covered(fitted, windows, number) for number in selected]
        return np.asarray(np.mean(covered, axis=0))

    def _is_covered(
        self,
        fitted: Coefficients,
        windows: TrainingWindows,
        number: int,
    ) -> BoolArray:
        """Return whether [choices, F] of a window are inside."""
        states = windows.states[number]
        ahead_s = fitted.centre.step_s * np.arange(1, len(states) + 1)
        paths = motion_prior.path_mixture(fitted, windows.twists[number, None], ahead_s)
        forecast = PlanarForecast(
            paths.weights, paths.means, paths.covariances, np.eye(4), np.eye(4)
        )
        # A larger region holds a state if the original region holds the shrunk deviation.
        shrunk = paths.centre + (states - paths.centre) / self.choices[:, None, None]
        samples = forecast.sample(self.num_samples, seed=number)
        threshold = np.quantile(forecast.log_density(samples), 1 - self.target, axis=0)
        return np.asarray(forecast.log_density(shrunk) >= threshold)


def rescaled(
    fitted: Coefficients,
    factors: FloatArray,  # [F]
) -> Coefficients:
    """Multiply the deviations from the central path by the factor [F] of their step."""
    spread = replace(
        fitted.spread,
        basis=fitted.spread.basis * factors[:, None, None],
        residual_variance=fitted.spread.residual_variance * factors[:, None] ** 2,
    )
    return replace(fitted, spread=spread)
