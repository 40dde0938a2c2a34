"""Kalman forecasters on the vehicle's plane: constant turn rate, with or without acceleration, extended or unscented.

Past poses are measurements of (x, z, yaw); for the future the filter predicts without any. Yaw is unwrapped before
filtering and never wrapped inside, so +-pi is no special place. Height, pitch and roll are those of the last pose, on
the plane that the past motion suggests. With one sample the futures are the filter's mean, with more they are paths
drawn from it. A single past pose is held in the mean, with a wide covariance.

The process and measurement noise in `turn_rate.toml` is fitted by maximum likelihood: `geovp forecast fit-kalman`.
"""

from __future__ import annotations

import functools
import tomllib
from dataclasses import dataclass
from importlib import resources
from typing import ClassVar

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from geovp_classic.errors import UnknownComponent
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.motion_models import SPEED, TURN, YAW, VehicleModel
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.geometry import planar
from geovp_classic.types import FloatArray, Trajectory

START_DEVIATION = np.array([20.0, 2.0, 3.0])  # of speed, turn rate and acceleration before any measurement


@functools.cache
def fitted(name: str) -> VehicleModel:
    """The constants of a table of `turn_rate.toml`; UnknownComponent for a name that it does not hold."""
    tables = tomllib.loads((resources.files("geovp_classic.poses") / "turn_rate.toml").read_text("utf-8"))
    if name not in tables:
        raise UnknownComponent(f"no fitted constants are called {name!r}: known are {', '.join(sorted(tables))}")
    return VehicleModel(**tables[name])


class ExtendedFilter(ExtendedKalmanFilter):  # type: ignore[misc]
    """filterpy's extended Kalman filter with a vehicle model; its update is in Joseph form."""

    x: FloatArray
    P: FloatArray

    def __init__(self, model: VehicleModel) -> None:
        """A filter before its first measurement."""
        super().__init__(dim_x=model.num_states, dim_z=3)
        self.model, self.R = model, model.measurement_noise

    def predict(self, dt_s: float) -> None:
        """Predict, linearised at the present state."""
        self.F, self.Q = self.model.jacobian(self.x, dt_s), self.model.process_noise(self.x, dt_s)
        self._dt_s = dt_s
        super().predict()
        self.P = symmetric(self.P)

    def predict_x(self, u: float = 0) -> None:
        """The state after the present step, by the model itself; there is no control input."""
        self.x = self.model.transition(self.x, self._dt_s)

    def update(self, measured: FloatArray) -> None:
        """Update with a measured (x, z, yaw)."""
        super().update(measured, lambda state: np.eye(3, len(state)), lambda state: state[:3])
        self.P = symmetric(self.P)


class UnscentedFilter(UnscentedKalmanFilter):  # type: ignore[misc]
    """filterpy's unscented Kalman filter with a vehicle model, without its loops over sigma points.

    The measurement is linear, so the unscented update is the linear one, here in Joseph form.
    """

    x: FloatArray
    P: FloatArray

    def __init__(self, model: VehicleModel) -> None:
        """A filter before its first measurement."""
        points = MerweScaledSigmaPoints(model.num_states, alpha=0.5, beta=2.0, kappa=0.0)
        super().__init__(model.num_states, 3, 0.1, hx=lambda state: state[:3], fx=model.transition, points=points)
        self.model, self.R = model, model.measurement_noise

    def predict(self, dt_s: float) -> None:
        """Predict with sigma points."""
        self.Q = self.model.process_noise(self.x, dt_s)
        super().predict(dt_s)
        self.P = symmetric(self.P)

    def compute_process_sigmas(self, dt: float, fx: object = None, **fx_args: object) -> None:
        """All sigma points at once: 5 times as fast as filterpy's loop."""
        self.sigmas_f = self.model.transition(self.points_fn.sigma_points(self.x, self.P), dt)

    def update(self, measured: FloatArray) -> None:
        """Update with a measured (x, z, yaw): 3.4 times as fast as filterpy's."""
        self.x, self.P = joseph_update(self.x, self.P, measured, self.R)


Filter = ExtendedFilter | UnscentedFilter


def planar_states(
    world_from_cam: FloatArray,  # [T, 4, 4]
    num_past: int,
    vehicle_from_cam: FloatArray,  # [4, 4]
) -> FloatArray:
    """(x, z, yaw) [T, 3] on the plane of the last past camera, yaw unwrapped and 0 there."""
    states = planar.reduce(world_from_cam, world_from_cam[num_past - 1], vehicle_from_cam)
    yaw_rad = np.unwrap(states[:, YAW])
    states[:, YAW] = yaw_rad - yaw_rad[num_past - 1]  # after any number of full turns
    return states


def joseph_update(
    state: FloatArray,  # [..., n]
    covariance: FloatArray,  # [..., n, n]
    measured: FloatArray,  # [..., 3], of the first three states
    noise: FloatArray,  # [3, 3]
) -> tuple[FloatArray, FloatArray]:
    """State and covariance after a linear measurement, in Joseph form, for any number of filters at once.

    350 of them take a thirtieth of the time of filterpy's updates.
    """
    gain = np.swapaxes(np.linalg.solve(covariance[..., :3, :3] + noise, covariance[..., :3, :]), -1, -2)
    kept = np.eye(state.shape[-1]) - gain @ np.eye(3, state.shape[-1])
    covariance = kept @ covariance @ np.swapaxes(kept, -1, -2) + gain @ noise @ np.swapaxes(gain, -1, -2)
    return state + (gain @ (measured - state[..., :3])[..., None])[..., 0], symmetric(covariance)


def initial_state(
    measured: FloatArray,  # [..., P, 3], yaw unwrapped
    times_s: FloatArray,  # [..., P]
    model: VehicleModel,
) -> tuple[FloatArray, FloatArray]:
    """State [..., n] and wide covariance [..., n, n] at the first pose, with the velocity of the first step."""
    state = np.zeros((*measured.shape[:-2], model.num_states))
    state[..., :3] = measured[..., 0, :]
    if measured.shape[-2] > 1:
        dt_s = times_s[..., 1] - times_s[..., 0]
        step, yaw = measured[..., 1, :] - measured[..., 0, :], measured[..., 0, YAW]
        state[..., SPEED] = (step[..., 0] * np.sin(yaw) + step[..., 1] * np.cos(yaw)) / dt_s
        state[..., TURN] = step[..., 2] / dt_s
    variances = np.concatenate([np.diag(model.measurement_noise), START_DEVIATION[: model.num_states - 3] ** 2])
    return state, np.broadcast_to(np.diag(variances), (*state.shape, model.num_states)).copy()


def symmetric(covariance: FloatArray) -> FloatArray:
    """The mean of a covariance [..., n, n] and its transpose, which differ by rounding."""
    return 0.5 * (covariance + np.swapaxes(covariance, -1, -2))


def run(kalman: Filter, measured: FloatArray, times_s: FloatArray) -> None:
    """Filter measured (x, z, yaw) [P, 3], yaw unwrapped; afterwards the filter is at the last one."""
    kalman.x, kalman.P = initial_state(measured, times_s, kalman.model)
    for dt_s, state in zip(np.diff(times_s), measured[1:], strict=True):
        kalman.predict(float(dt_s))
        kalman.update(state)


@dataclass(frozen=True)
class TurnRateKalman:
    """Constant turn rate and speed (CTRV), extended Kalman filter."""

    constants: str = "turn-rate"
    seed: int = 0
    filter_type: ClassVar[type[Filter]] = ExtendedFilter

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4]: the mean, or draws when more than one is asked for."""
        if num_samples == 1:
            mean = self.distribution(past, times_s)
            return planar.lift(mean.means, mean.world_from_reference, mean.vehicle_from_cam)
        steps_s = np.diff(past_motion.seconds_ahead(past, times_s), prepend=0.0)
        kalman, plane, unit = self._filtered(past)
        paths = _sample_paths(kalman, steps_s, num_samples, np.random.default_rng(self.seed))
        return planar.lift(paths * unit, past.world_from_cam[-1], plane)

    def distribution(self, past: Trajectory, times_s: FloatArray) -> PlanarForecast:
        """The predictive Gaussian of (x, z, yaw) at every future time."""
        steps_s = np.diff(past_motion.seconds_ahead(past, times_s), prepend=0.0)
        kalman, plane, unit = self._filtered(past)
        means, covariances = [], []
        for dt_s in steps_s:
            kalman.predict(float(dt_s))
            means.append(kalman.x[:3] * unit)
            covariances.append(kalman.P[:3, :3] * unit[:, None] * unit)
        return PlanarForecast(
            np.ones(1), np.stack(means)[None], np.stack(covariances)[None], past.world_from_cam[-1], plane
        )

    def _filtered(self, past: Trajectory) -> tuple[Filter, FloatArray, FloatArray]:
        """The filter at the last pose, vehicle_from_cam of its plane, and (x, z, yaw) of the past's unit for its 1."""
        metric, metres_per_unit = past_motion.in_metres(past)
        plane = past_motion.vehicle_from_cam(metric)
        kalman = self.filter_type(fitted(self.constants))
        run(kalman, planar_states(metric.world_from_cam, len(metric), plane), metric.times_s)
        return kalman, plane, np.array([1 / metres_per_unit, 1 / metres_per_unit, 1.0])


@dataclass(frozen=True)
class TurnRateUnscented(TurnRateKalman):
    """Constant turn rate and speed (CTRV), unscented Kalman filter."""

    filter_type: ClassVar[type[Filter]] = UnscentedFilter


@dataclass(frozen=True)
class AccelerationKalman(TurnRateKalman):
    """Constant turn rate and acceleration (CTRA), extended Kalman filter; damped or not as its constants say."""

    constants: str = "acceleration-damped"  # or "acceleration"


def _sample_paths(kalman: Filter, steps_s: FloatArray, num_samples: int, rng: np.random.Generator) -> FloatArray:
    """Paths [S, F, 3]: a start drawn from the filter's state, then the motion with process noise."""
    model, num_states = kalman.model, len(kalman.x)
    states = kalman.x + rng.standard_normal((num_samples, num_states)) @ _root(kalman.P).T
    path = []
    for dt_s in steps_s:
        noise = _root(model.process_noise(states, dt_s)) @ rng.standard_normal((num_samples, num_states, 1))
        states = model.transition(states, dt_s) + noise[..., 0]
        path.append(states[:, :3])
    return np.stack(path, axis=1)


def _root(covariance: FloatArray) -> FloatArray:
    """A with A A' = covariance, also where that is singular."""
    values, vectors = np.linalg.eigh(covariance)
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    return root
