"""Make the prior's regions hold what they say on roads that it was not fitted to.

How sure the spread network is follows from likelihood; this sets the size of all regions at one horizon by a common
factor, as split conformal prediction does (Vovk et al. 2005; Romano et al. 2019). Windows of one sequence are far from
independent, so every sequence has the same say, whatever its length.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.forecasting.histories import Examples
from geovp_classic.forecasting import motion_prior
from geovp_classic.forecasting.motion_network import Coefficients
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.types import FloatArray

HELD = 0.9  # what the region is to hold
HORIZONS = (1, 3, 5, 10, 15, 20)  # steps of the grid at which the factor is measured
FACTORS = np.geomspace(0.4, 2.5, 41)
NUM_DRAWS = 400
STRIDE = 5  # of the examples: neighbours say the same


Unseen = Sequence[tuple[Coefficients, Examples]]  # pieces of one sequence, each with a fit that doesn't know it


def scales(sequences: Iterable[Unseen]) -> FloatArray:
    """Factor [F] by which each horizon's region is to be resized; all pieces of a sequence make one voice."""
    sequences = list(sequences)
    held = np.mean([_shares_of(pieces) for pieces in sequences], axis=0)  # [factors, horizons]
    at_horizons = [np.interp(HELD, np.maximum.accumulate(share), np.log(FACTORS)) for share in held.T]
    steps = np.arange(1, sequences[0][0][0].num_steps + 1)
    return np.asarray(np.exp(np.interp(steps, HORIZONS, at_horizons)))


def _shares_of(pieces: Unseen) -> FloatArray:
    shares = [held_shares(fitted, data) for fitted, data in pieces]
    return np.asarray(np.average(shares, axis=0, weights=[len(data) for _, data in pieces]))


def held_shares(fitted: Coefficients, data: Examples) -> FloatArray:
    """Share [factors, horizons] of true states inside the HELD region, for every factor that it is resized by."""
    chosen = data.chosen(np.arange(0, len(data), STRIDE))
    return np.asarray(np.mean([_held(fitted, chosen, number) for number in range(len(chosen))], axis=0))


def resized(fitted: Coefficients, factors: FloatArray) -> Coefficients:
    """The same centre path, and deviations from it multiplied by a factor [F] of their step."""
    return replace(
        fitted, basis=fitted.basis * factors[:, None, None], floor=fitted.floor * np.square(factors)[:, None]
    )


def _held(fitted: Coefficients, data: Examples, number: int) -> FloatArray:
    steps = np.array(HORIZONS)
    outlook = motion_prior.outlook(fitted, data.rates[number : number + 1], fitted.step_s * steps)
    forecast = PlanarForecast(outlook.weights, *outlook.moments(), np.eye(4), np.eye(4))
    # A region that grows by a factor holds a state if the one of old size holds its deviation, shrunk by the factor.
    off = data.states[number, steps - 1] - outlook.centre
    shrunk = outlook.centre + off / FACTORS[:, None, None]
    drawn = np.sort(forecast.log_density(forecast.draws(NUM_DRAWS, seed=number)), axis=0)
    return forecast.log_density(shrunk) >= drawn[round((1 - HELD) * NUM_DRAWS)]
