"""Kalman forecasters on the vehicle's plane: constant turn rate, with or without acceleration, extended or unscented.

Past poses are measurements of (x, z, yaw); the filter runs on through the future without any. Yaw is unwrapped before
filtering and never wrapped inside, so +-pi is no special place. Height, pitch and roll are those of the last pose, on
the plane that the past motion suggests. With one sample the futures are the filter's mean, with more they are paths
drawn from it. A single past pose is held in the mean, with a wide covariance. A past without metres is taken as driven
at SCALE_FREE_SPEED_M_S, for which the noises were fitted.

The constants in `turn_rate.toml` are fitted by maximum likelihood: `geovp forecast fit-kalman`.
"""

from __future__ import annotations

import functools
import tomllib
from dataclasses import dataclass
from importlib import resources

import numpy as np

from geovp_classic.errors import UnknownComponent
from geovp_classic.forecasting import kalman_filters, past_motion
from geovp_classic.forecasting.kalman_filters import ExtendedFilter, Filter, KalmanConstants, UnscentedFilter
from geovp_classic.forecasting.motion_models import NUM_STATES, YAW, VehicleModel
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.geometry import planar
from geovp_classic.types import FloatArray, Trajectory

SCALE_FREE_SPEED_M_S = 9.0  # about the median of the train poses


@functools.cache
def fitted(name: str) -> KalmanConstants:
    """The constants of a table of `turn_rate.toml`; UnknownComponent for a name that it does not hold."""
    tables = tomllib.loads((resources.files("geovp_classic.poses") / "turn_rate.toml").read_text("utf-8"))
    if name not in tables:
        raise UnknownComponent(f"no fitted constants are called {name!r}: known are {', '.join(sorted(tables))}")
    table = dict(tables[name])
    position_noise_m, yaw_noise_rad = table.pop("position_noise_m"), table.pop("yaw_noise_rad")
    return KalmanConstants(VehicleModel(**table), position_noise_m, yaw_noise_rad)


@dataclass(frozen=True)
class TurnRateKalman:
    """Constant turn rate and speed (CTRV), extended Kalman filter."""

    constants: str = "turn-rate"
    seed: int = 0

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4]: the mean, or draws when more than one is asked for."""
        return _forecast(ExtendedFilter(fitted(self.constants), 5), past, times_s, num_samples, self.seed)

    def distribution(self, past: Trajectory, times_s: FloatArray) -> PlanarForecast:
        """The predictive Gaussian of (x, z, yaw) at every future time."""
        return _distribution(ExtendedFilter(fitted(self.constants), 5), past, times_s)


@dataclass(frozen=True)
class TurnRateUnscented:
    """Constant turn rate and speed (CTRV), unscented Kalman filter."""

    constants: str = "turn-rate"
    seed: int = 0

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4]: the mean, or draws when more than one is asked for."""
        return _forecast(UnscentedFilter(fitted(self.constants), 5), past, times_s, num_samples, self.seed)

    def distribution(self, past: Trajectory, times_s: FloatArray) -> PlanarForecast:
        """The predictive Gaussian of (x, z, yaw) at every future time."""
        return _distribution(UnscentedFilter(fitted(self.constants), 5), past, times_s)


@dataclass(frozen=True)
class AccelerationKalman:
    """Turn rate and acceleration (CTRA), extended Kalman filter; damped or not as its constants say."""

    constants: str = "acceleration-damped"  # or "acceleration"
    seed: int = 0

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4]: the mean, or draws when more than one is asked for."""
        return _forecast(ExtendedFilter(fitted(self.constants), NUM_STATES), past, times_s, num_samples, self.seed)

    def distribution(self, past: Trajectory, times_s: FloatArray) -> PlanarForecast:
        """The predictive Gaussian of (x, z, yaw) at every future time."""
        return _distribution(ExtendedFilter(fitted(self.constants), NUM_STATES), past, times_s)


def _started(kalman: Filter, past: Trajectory) -> tuple[Filter, FloatArray]:
    """The filter at the last pose of a metric past, and the plane it lives on."""
    plane = past_motion.vehicle_from_cam(past)
    measured = planar.reduce(past.world_from_cam, past.world_from_cam[-1], plane)
    measured[:, YAW] = np.unwrap(measured[:, YAW])
    measured[:, YAW] -= measured[-1, YAW]  # the last one is the origin, whichever way round it was reached
    kalman_filters.run(kalman, measured, past.times_s)
    return kalman, plane


def _distribution(kalman: Filter, past: Trajectory, times_s: FloatArray) -> PlanarForecast:
    ahead_s = past_motion.seconds_ahead(past, times_s)
    factor = past_motion.metres_per_unit(past, SCALE_FREE_SPEED_M_S)
    kalman, plane = _started(kalman, past_motion.scaled(past, factor))
    means, covariances = [], []
    for dt_s in np.diff(ahead_s, prepend=0.0):
        kalman.advance(float(dt_s))
        means.append(kalman.x[:3].copy())
        covariances.append(kalman.P[:3, :3].copy())
    unit = np.array([1 / factor, 1 / factor, 1.0])
    spread = np.stack(covariances)[None] * unit[:, None] * unit
    return PlanarForecast(np.ones(1), np.stack(means)[None] * unit, spread, past.world_from_cam[-1], plane)


def _forecast(kalman: Filter, past: Trajectory, times_s: FloatArray, num_samples: int, seed: int) -> FloatArray:
    if num_samples == 1:
        mean = _distribution(kalman, past, times_s)
        return planar.lift(mean.means, mean.world_from_reference, mean.vehicle_from_cam)
    ahead_s = past_motion.seconds_ahead(past, times_s)
    factor = past_motion.metres_per_unit(past, SCALE_FREE_SPEED_M_S)
    kalman, plane = _started(kalman, past_motion.scaled(past, factor))
    paths = _paths(kalman, np.diff(ahead_s, prepend=0.0), num_samples, np.random.default_rng(seed))
    return planar.lift(paths / np.array([factor, factor, 1.0]), past.world_from_cam[-1], plane)


def _paths(kalman: Filter, steps_s: FloatArray, num_samples: int, rng: np.random.Generator) -> FloatArray:
    """Paths [S, F, 3]: a start drawn from the filter's belief, then the motion with its noise."""
    model, num_states = kalman.constants.model, len(kalman.x)
    states = kalman.x + rng.standard_normal((num_samples, num_states)) @ _root(kalman.P).T
    path = []
    for dt_s in steps_s:
        noise = _root(model.noise(states, dt_s)) @ rng.standard_normal((num_samples, num_states, 1))
        states = model.moved(states, dt_s) + noise[..., 0]
        path.append(states[:, :3])
    return np.stack(path, axis=1)


def _root(covariance: FloatArray) -> FloatArray:
    """A with A A' = covariance, also where that is singular."""
    values, vectors = np.linalg.eigh(covariance)
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    return root
