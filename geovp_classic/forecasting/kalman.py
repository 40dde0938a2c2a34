"""Kalman forecasters on the vehicle's plane: CTRV and CTRA, alone or interacting.

Past poses are measurements of (x, z, yaw); the future is predicted without measurements.
`benchmarks/studies/fitting` fits the noise in `turn_rate.toml` by maximum likelihood.
"""

import abc
import functools
import tomllib
from dataclasses import dataclass
from typing import Literal

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from scipy.linalg import block_diag

from geovp_classic import files
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.motion_models import VehicleModel
from geovp_classic.forecasting.planar_forecaster import Modes, PlanarForecaster
from geovp_classic.geometry import planar
from geovp_classic.types import FloatArray, Trajectory

Constants = Literal["turn-rate", "acceleration", "acceleration-damped"]  # tables of turn_rate.toml
Belief = tuple[FloatArray, FloatArray]  # state [n] and covariance [n, n]


@functools.cache
def fitted(name: Constants) -> VehicleModel:
    """Return the vehicle model of a table of `turn_rate.toml`."""
    text = files.read_text(files.PACKAGED / "turn_rate.toml")
    return VehicleModel(**tomllib.loads(text)[name])


class ExtendedFilter(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy has no types
    """Extended Kalman filter of a vehicle; its control input is the duration of a step."""

    def __init__(self, model: VehicleModel, belief: Belief) -> None:
        state, covariance = belief
        super().__init__(dim_x=len(state), dim_z=3)
        self.model = model
        self.x = state.copy()
        self.P = covariance.copy()
        self.R = model.measurement_noise

    def predict(self, u: float = 0.0) -> None:
        """Predict the belief after u seconds, linearised at the present state."""
        self.F = self.model.jacobian(self.x, u)
        self.Q = self.model.process_noise(self.x, u)
        super().predict(u)

    def predict_x(self, u: float = 0.0) -> None:
        """Move the state itself without linearisation, as filterpy suggests."""
        self.x = self.model.transition(self.x, u)

    def update(self, z: FloatArray) -> None:
        """Correct the belief by a measured (x, z, yaw) [3]."""
        super().update(z, lambda state: np.eye(3, len(state)), lambda state: state[:3])


@dataclass(frozen=True)
class KalmanForecaster(PlanarForecaster, abc.ABC):
    """Forecaster by one or several weighted filters, each of which predicts a mode."""

    # Standard deviations of the first speed (m/s), turn rate (rad/s) and acceleration (m/s^2);
    # three of them contain any road vehicle
    initial_deviations: tuple[float, float, float] = (20.0, 2.0, 3.0)

    @abc.abstractmethod
    def filtered(
        self,
        measured: FloatArray,  # [P, 3], as (x, z, yaw), yaw unwrapped
        times_s: FloatArray,  # [P]
    ) -> list[tuple[float, ExtendedFilter]]:
        """Return the filters at the last measurement, with weights of sum 1."""

    def initial_belief(
        self,
        measured: FloatArray,  # [P, 3], as (x, z, yaw)
        times_s: FloatArray,  # [P]
        model: VehicleModel,
        num_states: int,
    ) -> Belief:
        """Return a wide belief at the first pose, with the velocity of the first step."""
        state = np.zeros(num_states)
        state[:3] = measured[0]
        if len(measured) > 1:
            x, z, yaw = (measured[1] - measured[0]) / (times_s[1] - times_s[0])
            heading = measured[0, 2]
            state[3] = x * np.sin(heading) + z * np.cos(heading)
            state[4] = yaw
        velocity_covariance = np.diag(self.initial_deviations[: num_states - 3]) ** 2
        return state, block_diag(model.measurement_noise, velocity_covariance)

    def modes(
        self,
        past: Trajectory,
        ahead_s: FloatArray,  # [F]
    ) -> Modes:
        """Return the mean and the covariance at every time, one mode per filter."""
        filters = self._present(past)
        means = []
        covariances = []
        for _, vehicle in filters:
            for dt_s in np.diff(ahead_s, prepend=0.0):
                vehicle.predict(dt_s)
                means.append(vehicle.x[:3])
                covariances.append(vehicle.P[:3, :3])
        shape = (len(filters), len(ahead_s), 3)
        weights = np.array([weight for weight, _ in filters])
        return weights, np.reshape(means, shape), np.reshape(covariances, (*shape, 3))

    def paths(
        self,
        past: Trajectory,
        ahead_s: FloatArray,  # [F]
        num_samples: int,
    ) -> FloatArray:
        """Return the mean [1, F, 3], or paths [S, F, 3] drawn from the beliefs and their noise."""
        if num_samples == 1:
            weights, means, _ = self.modes(past, ahead_s)
            return np.tensordot(weights, means, axes=1)[None]
        filters = self._present(past)
        rng = np.random.default_rng(self.seed)
        counts = rng.multinomial(num_samples, [weight for weight, _ in filters])
        paths = []
        for (_, vehicle), count in zip(filters, counts, strict=True):
            # Draw present states, and move each with noise of its own.
            states = rng.multivariate_normal(vehicle.x, vehicle.P, count)
            path = np.zeros((count, len(ahead_s), 3))
            for step, dt_s in enumerate(np.diff(ahead_s, prepend=0.0)):
                if count == 0:
                    break
                covariance = vehicle.model.process_noise(states.mean(axis=0), dt_s)
                noise = rng.multivariate_normal(np.zeros(len(covariance)), covariance, count)
                states = vehicle.model.transition(states, dt_s) + noise
                path[:, step] = states[:, :3]
            paths.append(path)
        # The first samples, too, come from all filters.
        return rng.permutation(np.concatenate(paths))

    def _present(self, past: Trajectory) -> list[tuple[float, ExtendedFilter]]:
        """Return the filters at the last pose, whose plane and heading are the reference."""
        poses = past.world_from_cam
        states = planar.reduce(poses, poses[-1], past_motion.vehicle_from_cam(past))
        states[:, 2] = np.unwrap(states[:, 2])
        states[:, 2] -= states[-1, 2]
        return self.filtered(states, past.times_s)


@dataclass(frozen=True)
class TurnRateKalman(KalmanForecaster):
    """Constant turn rate and speed (CTRV), extended Kalman filter."""

    constants: Constants = "turn-rate"

    @property
    def model(self) -> VehicleModel:
        """Return the vehicle with the fitted constants."""
        return fitted(self.constants)

    def filtered(
        self,
        measured: FloatArray,  # [P, 3], as (x, z, yaw), yaw unwrapped
        times_s: FloatArray,  # [P]
    ) -> list[tuple[float, ExtendedFilter]]:
        """Return the filter at the last measurement, with weight 1."""
        belief = self.initial_belief(measured, times_s, self.model, self.model.num_states)
        vehicle = ExtendedFilter(self.model, belief)
        for dt_s, state in zip(np.diff(times_s), measured[1:], strict=True):
            vehicle.predict(dt_s)
            vehicle.update(state)
        return [(1.0, vehicle)]


@dataclass(frozen=True)
class AccelerationKalman(TurnRateKalman):
    """Constant turn rate and acceleration (CTRA), extended Kalman filter."""

    constants: Constants = "acceleration-damped"
