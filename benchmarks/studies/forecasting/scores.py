"""Accuracy and calibration of forecasts, window by window and step by step.

Errors are taken on the x-z plane of the last observed camera: (x, z, yaw_rad) of the true and the forecast cameras.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import pdist

from geovp_classic.forecasting.kalman import TurnRateKalman
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.geometry import planar
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory

Window = tuple[Trajectory, Trajectory]  # past and future of a piece of one sequence
Corruption = Callable[[Trajectory], Trajectory]  # of the past, before the forecaster sees it


@dataclass(frozen=True)
class Scores:
    """One row per window; NaN for a forecaster without a distribution."""

    position_m: FloatArray  # [N, F]
    yaw_deg: FloatArray  # [N, F]
    negative_log_density: FloatArray  # [N, F], nats per square metre and radian
    rank: FloatArray  # [N, F]: the truth is in the region of a probability when its rank is at most that
    energy_m: FloatArray  # [N], energy score of whole paths in the plane, averaged over steps
    turned_deg: FloatArray  # [N], true change of heading until the last step


def measure(
    forecaster: Forecaster, windows: Iterable[Window], num_samples: int = 100, corruption: Corruption | None = None
) -> Scores:
    """Scores of all windows."""
    rows = [_row(forecaster, window, num_samples, corruption) for window in windows]
    return Scores(*(np.stack(column) for column in zip(*rows, strict=True)))


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
    forecast: PlanarForecast, states: FloatArray, num_samples: int = 400, seed: int = 0
) -> FloatArray:
    """Share [F] of the forecast's own samples that are likelier than the true state [F, 3] (Hyndman 1996).

    For a Gaussian, "rank at most 0.9" is the 90 % ellipsoid; for a mixture the region may be in pieces.
    """
    truth = forecast.log_density(states[None])[0]
    return np.asarray((forecast.log_density(forecast.sample(num_samples, seed)) > truth).mean(0))


def _row(
    forecaster: Forecaster, window: Window, num_samples: int, corruption: Corruption | None
) -> tuple[FloatArray, ...]:
    (past, future), reference = window, window[0].world_from_cam[-1]
    past = past if corruption is None else corruption(past)
    truth = _planar(future.world_from_cam, reference)
    error = _planar(forecaster.forecast(past, future.times_s)[0], reference) - truth
    yaw_deg = np.degrees(np.abs((error[:, 2] + np.pi) % (2 * np.pi) - np.pi))
    position_m, turned_deg = np.linalg.norm(error[:, :2], axis=-1), np.degrees(np.unwrap(truth[:, 2])[-1:])[0]
    if not isinstance(forecaster, TurnRateKalman | MotionPrior):
        unknown = np.full(len(future), np.nan)
        return position_m, yaw_deg, unknown, unknown, np.array(position_m.mean()), turned_deg
    forecast = forecaster.distribution(past, future.times_s)
    states = forecast.states_of(future.world_from_cam)
    samples = _planar(forecaster.forecast(past, future.times_s, num_samples), reference)[..., :2]
    negative_log_density, rank = -forecast.log_density(states[None])[0], highest_density_rank(forecast, states)
    return position_m, yaw_deg, negative_log_density, rank, np.array(energy_score(samples, truth[:, :2])), turned_deg


def _planar(world_from_cam: FloatArray, world_from_reference: FloatArray) -> FloatArray:
    return planar.reduce(world_from_cam, world_from_reference, planar.level_vehicle_from_cam())
