"""Calibrate the prior's regions on roads that it was not fitted to.

The spread network's deviations follow from likelihood; this sets the size of all regions at one
horizon by a common factor, as split conformal prediction does (Vovk et al. 2005; Romano et al.
2019). Windows of one sequence are far from independent, so every sequence has the same weight,
whatever its length.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from geovp_benchmarks.fitting.training_windows import NUM_FUTURE_STEPS, TrainingWindows
from geovp_classic.forecasting import motion_prior
from geovp_classic.forecasting.motion_network import Coefficients
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.types import FloatArray

COVERAGE = 0.9  # of the regions
HORIZONS = (1, 3, 5, 10, 15, 20)  # steps of the grid at which the factor is measured
FACTORS = np.geomspace(0.4, 2.5, 41)
NUM_SAMPLES = 400
STRIDE = 5  # of the windows: neighbours are alike

HeldOut = Sequence[
    tuple[Coefficients, TrainingWindows]
]  # pieces of one sequence, each with a fit without it


def factors(sequences: Iterable[HeldOut]) -> FloatArray:
    """Factor [F] by which each horizon's region is to be rescaled; every sequence has the same
    weight.
    """
    curves = []
    for pieces in sequences:
        shares = [coverage(fitted, windows) for fitted, windows in pieces]
        curves.append(np.average(shares, axis=0, weights=[len(windows) for _, windows in pieces]))
    increasing = np.maximum.accumulate(np.mean(curves, axis=0))  # [factors, horizons]
    at_horizons = [np.interp(COVERAGE, share, np.log(FACTORS)) for share in increasing.T]
    return np.asarray(np.exp(np.interp(np.arange(1, NUM_FUTURE_STEPS + 1), HORIZONS, at_horizons)))


def coverage(fitted: Coefficients, data: TrainingWindows) -> FloatArray:
    """Share [factors, horizons] of true states inside the COVERAGE region, rescaled by each of
    FACTORS.
    """
    return np.asarray(
        np.mean([_covered(fitted, data, n) for n in range(0, len(data), STRIDE)], axis=0)
    )


def rescaled(fitted: Coefficients, factors: FloatArray) -> Coefficients:
    """The same centre path, and deviations from it multiplied by a factor [F] of their step."""
    basis = fitted.spread.basis * factors[:, None, None]
    residual_variance = fitted.spread.residual_variance * np.square(factors)[:, None]
    return replace(
        fitted, spread=replace(fitted.spread, basis=basis, residual_variance=residual_variance)
    )


def _covered(fitted: Coefficients, data: TrainingWindows, number: int) -> FloatArray:
    steps = np.array(HORIZONS)
    paths = motion_prior.path_mixture(
        fitted, data.twists[number : number + 1], fitted.centre.step_s * steps
    )
    forecast = PlanarForecast(paths.weights, *paths.moments(), np.eye(4), np.eye(4))
    # A region that grows by a factor holds a state if the one of old size holds its deviation,
    # shrunk by the factor.
    shrunk = paths.centre + (data.states[number, steps - 1] - paths.centre) / FACTORS[:, None, None]
    densities = np.sort(
        forecast.log_density(forecast.sample(NUM_SAMPLES, seed=number // STRIDE)), axis=0
    )
    return forecast.log_density(shrunk) >= densities[round((1 - COVERAGE) * NUM_SAMPLES)]
