"""Run filterpy's extended or unscented Kalman filter over measured (x, z, yaw) of a vehicle; updates in Joseph form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from geovp_classic.forecasting.motion_models import SPEED, TURN, YAW, VehicleModel
from geovp_classic.types import FloatArray

START_SPREAD = np.array([20.0, 2.0, 3.0])  # of speed, turn rate and acceleration before anything was measured


@dataclass(frozen=True)
class KalmanConstants:
    """The motion model and how noisy measured poses are."""

    model: VehicleModel
    position_noise_m: float
    yaw_noise_rad: float

    @property
    def measurement_noise(self) -> FloatArray:
        """The covariance [3, 3] of a measured (x, z, yaw)."""
        return np.diag(np.square([self.position_noise_m, self.position_noise_m, self.yaw_noise_rad]))


class Filter(Protocol):
    """What the forecasters need of a Kalman filter."""

    constants: KalmanConstants
    x: FloatArray  # [n]
    P: FloatArray  # [n, n]

    def advance(self, dt_s: float) -> None:
        """Predict."""
        ...

    def correct(self, measured: FloatArray) -> None:
        """Update with a measured (x, z, yaw)."""
        ...


class ExtendedFilter(ExtendedKalmanFilter):  # type: ignore[misc]
    """filterpy's extended filter for a vehicle model; its update is in Joseph form."""

    x: FloatArray
    P: FloatArray

    def __init__(self, constants: KalmanConstants, num_states: int) -> None:
        """A filter that has not measured anything yet."""
        super().__init__(dim_x=num_states, dim_z=3)
        self.constants, self.R = constants, constants.measurement_noise
        self.measures = np.eye(3, num_states)

    def advance(self, dt_s: float) -> None:
        """Predict: linearised where the state is now."""
        self.F, self.Q = self.constants.model.jacobian(self.x, dt_s), self.constants.model.noise(self.x, dt_s)
        self.x = self.constants.model.moved(self.x, dt_s)
        self.P = symmetric(self.F @ self.P @ self.F.T + self.Q)

    def correct(self, measured: FloatArray) -> None:
        """Update with a measured (x, z, yaw)."""
        self.update(measured, lambda state: self.measures, lambda state: state[:3])
        self.P = symmetric(self.P)


class UnscentedFilter(UnscentedKalmanFilter):  # type: ignore[misc]
    """filterpy's unscented filter; the measurement is linear, so its update can be in Joseph form too."""

    x: FloatArray
    P: FloatArray

    def __init__(self, constants: KalmanConstants, num_states: int) -> None:
        """A filter that has not measured anything yet."""
        points = MerweScaledSigmaPoints(num_states, alpha=0.5, beta=2.0, kappa=0.0)
        super().__init__(num_states, 3, dt=0.1, hx=lambda state: state[:3], fx=constants.model.moved, points=points)
        self.constants, self.R = constants, constants.measurement_noise
        self.measures = np.eye(3, num_states)

    def advance(self, dt_s: float) -> None:
        """Predict: sigma points through the motion."""
        self.Q = self.constants.model.noise(self.x, dt_s)
        self.predict(dt=dt_s)
        self.P = symmetric(self.P)

    def compute_process_sigmas(self, dt: float, fx: object = None, **fx_args: object) -> None:
        """As filterpy does it point by point, for all sigma points at once."""
        self.sigmas_f = self.constants.model.moved(self.points_fn.sigma_points(self.x, self.P), dt)

    def correct(self, measured: FloatArray) -> None:
        """Update with a measured (x, z, yaw)."""
        innovation = self.P[:3, :3] + self.R
        gain = np.linalg.solve(innovation, self.P[:3]).T
        kept = np.eye(len(self.x)) - gain @ self.measures
        self.x = self.x + gain @ (measured - self.x[:3])
        self.P = symmetric(kept @ self.P @ kept.T + gain @ self.R @ gain.T)


def start(
    measured: FloatArray,  # [..., P, 3], yaw unwrapped
    times_s: FloatArray,  # [..., P]
    constants: KalmanConstants,
    num_states: int,
) -> tuple[FloatArray, FloatArray]:
    """State [..., n] and covariance [..., n, n] at the first pose: the first step's velocity, hardly trusted."""
    state = np.zeros((*measured.shape[:-2], num_states))
    state[..., :3] = measured[..., 0, :]
    if measured.shape[-2] > 1:
        dt_s = times_s[..., 1] - times_s[..., 0]
        step, yaw = measured[..., 1, :] - measured[..., 0, :], measured[..., 0, YAW]
        state[..., SPEED] = (step[..., 0] * np.sin(yaw) + step[..., 1] * np.cos(yaw)) / dt_s
        state[..., TURN] = step[..., 2] / dt_s
    spread = np.concatenate([np.diag(constants.measurement_noise), START_SPREAD[: num_states - 3] ** 2])
    return state, np.broadcast_to(np.diag(spread), (*state.shape, num_states)).copy()


def symmetric(covariance: FloatArray) -> FloatArray:
    """Rounding off the two triangles' difference."""
    return 0.5 * (covariance + np.swapaxes(covariance, -1, -2))


def run(kalman: Filter, measured: FloatArray, times_s: FloatArray) -> None:
    """Filter measured (x, z, yaw) [P, 3], yaw unwrapped; afterwards the filter stands at the last one."""
    kalman.x, kalman.P = start(measured, times_s, kalman.constants, len(kalman.x))
    for dt_s, state in zip(np.diff(times_s), measured[1:], strict=True):
        kalman.advance(float(dt_s))
        kalman.correct(state)
