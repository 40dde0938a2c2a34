"""How far a forecast is off and how honest its spread is, window by window and step by step.

Errors are taken on the x-z plane of the last observed camera: (x, z, yaw_rad) of the true and the forecast cameras.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.spatial.distance import pdist

from benchmarks.forecasting.windows import Window
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.geometry import planar
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory

Spoil = Callable[[Trajectory], Trajectory]  # what a past goes through before the forecaster sees it


@runtime_checkable
class Probabilistic(Protocol):
    """A forecaster that says how sure it is."""

    def distribution(self, past: Trajectory, times_s: FloatArray) -> PlanarForecast:
        """The predictive mixture at every future time."""
        ...


@dataclass(frozen=True)
class Scores:
    """One row per window; NaN where a forecaster has no spread."""

    position_m: FloatArray  # [N, F]
    yaw_deg: FloatArray  # [N, F]
    negative_log_density: FloatArray  # [N, F], nats per square metre and radian
    rank: FloatArray  # [N, F]: the truth is in the region of a probability when its rank is at most that
    energy_m: FloatArray  # [N], energy score of whole paths in the plane, averaged over steps
    turned_deg: FloatArray  # [N], how far the vehicle truly turns until the last step


def measure(
    forecaster: Forecaster, windows: Iterable[Window], num_samples: int = 100, spoil: Spoil | None = None
) -> Scores:
    """Scores of all windows."""
    rows = [_row(forecaster, window, num_samples, spoil) for window in windows]
    columns = [np.stack(column) for column in zip(*rows, strict=True)]
    return Scores(*columns)


def energy_score(
    samples: FloatArray,  # [S, F, 2]
    truth: FloatArray,  # [F, 2]
) -> float:
    """E|X - y| - E|X - X'| / 2 with |.| the mean distance over the steps (Gneiting and Raftery 2007, eq. 21).

    The second mean is over pairs of different samples, so that it does not shrink with few of them; one sample gives
    the plain mean distance.
    """
    distance = float(np.linalg.norm(samples - truth, axis=-1).mean())
    if len(samples) == 1:
        return distance
    return distance - 0.5 * float(np.mean([pdist(samples[:, step]).mean() for step in range(samples.shape[1])]))


def highest_density_rank(
    forecast: PlanarForecast, states: FloatArray, num_draws: int = 400, seed: int = 0
) -> FloatArray:
    """Share [F] of the forecast's own draws that are likelier than the true state [F, 3] (Hyndman 1996).

    For a Gaussian, "rank at most 0.9" is the 90 % ellipsoid; for a mixture the region may be in pieces.
    """
    truth = forecast.log_density(states[None])[0]
    return np.asarray((forecast.log_density(forecast.draws(num_draws, seed)) > truth).mean(0))


def _row(forecaster: Forecaster, window: Window, num_samples: int, spoil: Spoil | None) -> tuple[FloatArray, ...]:
    past = window.past if spoil is None else spoil(window.past)
    times_s, reference = window.future.times_s, window.past.world_from_cam[-1]
    truth = _flat(window.future.world_from_cam, reference)
    off = _flat(forecaster.forecast(past, times_s)[0], reference) - truth
    yaw_deg = np.degrees(np.abs((off[:, 2] + np.pi) % (2 * np.pi) - np.pi))
    position_m, turned_deg = np.linalg.norm(off[:, :2], axis=-1), np.degrees(np.unwrap(truth[:, 2])[-1:])[0]
    if not isinstance(forecaster, Probabilistic):
        nothing = np.full(len(times_s), np.nan)
        return position_m, yaw_deg, nothing, nothing, np.array(position_m.mean()), turned_deg
    spread = forecaster.distribution(past, times_s)
    states = spread.states_of(window.future.world_from_cam)
    samples = _flat(forecaster.forecast(past, times_s, num_samples), reference)[..., :2]
    density = -spread.log_density(states[None])[0]
    rank = highest_density_rank(spread, states)
    return position_m, yaw_deg, density, rank, np.array(energy_score(samples, truth[:, :2])), turned_deg


def _flat(world_from_cam: FloatArray, world_from_reference: FloatArray) -> FloatArray:
    return planar.reduce(world_from_cam, world_from_reference, planar.level_vehicle_from_cam())
