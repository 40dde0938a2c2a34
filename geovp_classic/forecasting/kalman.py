"""Kalman forecasters on the vehicle's plane: CTRV and CTRA, extended or unscented.

Past poses are measurements of (x, z, yaw); the future is predicted without measurements.
`benchmarks/studies/fitting` fits the noise in `turn_rate.toml` by maximum likelihood.
"""

import functools
import tomllib
from dataclasses import dataclass
from itertools import accumulate
from typing import Literal

import numpy as np
from filterpy import kalman
from scipy.linalg import block_diag

from geovp_classic import files
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


def initial_belief(
    measured: FloatArray,  # [P, 3], as (x, z, yaw)
    times_s: FloatArray,  # [P]
    model: VehicleModel,
    # Standard deviations of speed, turn rate and acceleration
    deviations: tuple[float, ...] = (20.0, 2.0, 3.0),
) -> Belief:
    """Return a wide belief at the first pose, with the velocity of the first step."""
    state = np.zeros(model.num_states)
    state[:3] = measured[0]
    if len(measured) > 1:
        x, z, yaw = (measured[1] - measured[0]) / (times_s[1] - times_s[0])
        heading = measured[0, 2]
        state[3] = x * np.sin(heading) + z * np.cos(heading)
        state[4] = yaw
    velocity_covariance = np.diag(deviations[: model.num_states - 3]) ** 2
    return state, block_diag(model.measurement_noise, velocity_covariance)


@dataclass(frozen=True)
class TurnRateKalman(PlanarForecaster):
    """Constant turn rate and speed (CTRV), extended Kalman filter."""

    constants: Constants = "turn-rate"

    @property
    def model(self) -> VehicleModel:
        """Return the vehicle with the fitted constants."""
        return fitted(self.constants)

    def prediction(
        self,
        belief: Belief,
        dt_s: float,
    ) -> Belief:
        """Return the belief after dt, linearised at the present state."""
        state, covariance = belief
        jacobian = self.model.jacobian(state, dt_s)
        noise = self.model.process_noise(state, dt_s)
        _, covariance = kalman.predict(state, covariance, jacobian, noise)
        return self.model.transition(state, dt_s), covariance

    def filtered(
        self,
        measured: FloatArray,  # [P, 3], as (x, z, yaw), yaw unwrapped
        times_s: FloatArray,  # [P]
    ) -> Belief:
        """Return the belief at the last measurement."""
        belief = initial_belief(measured, times_s, self.model)
        noise = self.model.measurement_noise
        measurement = np.eye(3, self.model.num_states)
        for dt_s, state in zip(np.diff(times_s), measured[1:], strict=True):
            belief = kalman.update(*self.prediction(belief, dt_s), state, noise, measurement)
        return belief

    def modes(
        self,
        past: Trajectory,
        plane: FloatArray,  # [4, 4], vehicle_from_cam
        ahead_s: FloatArray,  # [F]
    ) -> Modes:
        """Return one mode: the predicted mean and covariance at every time."""
        steps_s = np.diff(ahead_s, prepend=0.0)
        present = self._present(past, plane)
        _, *beliefs = accumulate(steps_s, self.prediction, initial=present)
        means = np.stack([state[:3] for state, _ in beliefs])
        covariances = np.stack([matrix[:3, :3] for _, matrix in beliefs])
        return np.ones(1), means[None], covariances[None]

    def paths(
        self,
        past: Trajectory,
        plane: FloatArray,  # [4, 4], vehicle_from_cam
        ahead_s: FloatArray,  # [F]
        num_samples: int,
    ) -> FloatArray:
        """Return the mean [1, F, 3], or paths [S, F, 3] drawn from the belief and its noise."""
        if num_samples == 1:
            return self.modes(past, plane, ahead_s)[1]
        rng = np.random.default_rng(self.seed)
        states = rng.multivariate_normal(*self._present(past, plane), num_samples)
        path = []
        for dt_s in np.diff(ahead_s, prepend=0.0):
            covariance = self.model.process_noise(states.mean(axis=0), dt_s)
            noise = rng.multivariate_normal(np.zeros(len(covariance)), covariance, num_samples)
            states = self.model.transition(states, dt_s) + noise
            path.append(states[:, :3])
        return np.stack(path, axis=1)

    def _present(
        self,
        past: Trajectory,
        plane: FloatArray,  # [4, 4], vehicle_from_cam
    ) -> Belief:
        """Return the belief at the last pose, whose plane and heading are the reference."""
        poses = past.world_from_cam
        states = planar.reduce(poses, poses[-1], plane)
        states[:, 2] = np.unwrap(states[:, 2])
        states[:, 2] -= states[-1, 2]
        return self.filtered(states, past.times_s)


class TurnRateUnscented(TurnRateKalman):
    """Constant turn rate and speed (CTRV), unscented Kalman filter."""

    def prediction(
        self,
        belief: Belief,
        dt_s: float,
    ) -> Belief:
        """Return the belief after dt, from sigma points (Wan & van der Merwe 2000)."""
        points = kalman.MerweScaledSigmaPoints(len(belief[0]), alpha=0.5, beta=2.0, kappa=0.0)
        moved = self.model.transition(points.sigma_points(*belief), dt_s)
        noise = self.model.process_noise(belief[0], dt_s)
        return kalman.unscented_transform(moved, points.Wm, points.Wc, noise)


@dataclass(frozen=True)
class AccelerationKalman(TurnRateKalman):
    """Constant turn rate and acceleration (CTRA), extended Kalman filter."""

    constants: Constants = "acceleration-damped"
