"""Motion models of a vehicle: constant turn rate, and constant speed (CTRV) or acceleration (CTRA).

The state [..., n] is x, z, yaw_rad, speed, turn rate (rad/s) and, in CTRA, acceleration. Turn rate
and acceleration decay exponentially. Leading axes are free: one state or thousands.
"""

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class VehicleModel:
    """Constants of the motion, its process noise and the measurement noise."""

    turn_damping_hz: float  # the turn rate falls by 1/e in 1 / turn_damping_hz seconds
    acceleration_damping_hz: float
    lever_arm_m: float  # from the rear axle, which moves along its heading, to the camera
    slip_noise: float  # m / sqrt(s), of the position
    speed_noise: float  # m/s / sqrt(s)
    turn_noise: float  # rad/s / sqrt(s)
    acceleration_noise: float  # m/s^2 / sqrt(s); 0 for CTRV
    position_noise_m: float = 0.01
    yaw_noise_rad: float = 0.001

    @property
    def num_states(self) -> int:
        """5 for CTRV, 6 for CTRA."""
        return 6 if self.acceleration_noise > 0 else 5

    @property
    def measurement_noise(self) -> FloatArray:
        """Covariance [3, 3] of a measured (x, z, yaw)."""
        position_m = self.position_noise_m
        return np.diag([position_m, position_m, self.yaw_noise_rad]) ** 2

    def transition(
        self,
        state: FloatArray,  # [..., n]
        dt_s: FloatArray | float,
    ) -> FloatArray:
        """Return the state [..., n] after dt [...]."""
        dt_s = np.asarray(dt_s)
        x, z, yaw, speed, turn_rate = np.moveaxis(state[..., :5], -1, 0)
        acceleration = state[..., 5] if state.shape[-1] == 6 else np.zeros_like(speed)
        turn, turn_rate = _decay(turn_rate, self.turn_damping_hz, dt_s)
        gain, acceleration = _decay(acceleration, self.acceleration_damping_hz, dt_s)
        stops = speed * (speed + gain) < 0  # braking ends at rest
        end_speed = np.where(stops, 0.0, speed + gain)
        acceleration = np.where(stops, 0.0, acceleration)
        end_yaw = yaw + turn
        chord_yaw = yaw + turn / 2
        chord = 0.5 * (speed + end_speed) * dt_s * np.sinc(turn / (2 * np.pi))
        swing_x = self.lever_arm_m * (np.sin(end_yaw) - np.sin(yaw))
        swing_z = self.lever_arm_m * (np.cos(end_yaw) - np.cos(yaw))
        end_x = x + chord * np.sin(chord_yaw) + swing_x
        end_z = z + chord * np.cos(chord_yaw) + swing_z
        end = np.stack([end_x, end_z, end_yaw, end_speed, turn_rate, acceleration], axis=-1)
        return end[..., : state.shape[-1]]

    def jacobian(
        self,
        state: FloatArray,  # [..., n]
        dt_s: FloatArray | float,
    ) -> FloatArray:
        """Return the derivative of `transition` by the state [..., n, n] (central differences)."""
        step = 1e-5
        shifts = step * np.eye(state.shape[-1])
        dt_s = np.asarray(dt_s)[..., None]
        above = self.transition(state[..., None, :] + shifts, dt_s)
        below = self.transition(state[..., None, :] - shifts, dt_s)
        return np.swapaxes(above - below, -1, -2) / (2 * step)

    def process_noise(
        self,
        state: FloatArray,  # [n]
        dt_s: float,
    ) -> FloatArray:
        """Return the covariance [n, n] that white noise adds in dt.

        It is the integral of J q q' J' over dt, where J(t) is the response after a time t; damping
        within dt is neglected. Gauss-Legendre quadrature with three nodes is exact to order 5 in t.
        """
        nodes, weights = np.polynomial.legendre.leggauss(3)
        undamped = replace(self, turn_damping_hz=0.0, acceleration_damping_hz=0.0)
        states = np.tile(state, (3, 1))
        response = undamped.jacobian(states, dt_s / 2 * (1 + nodes))  # [3, n, n]
        densities = np.array(
            [
                self.slip_noise,
                self.slip_noise,
                0.0,
                self.speed_noise,
                self.turn_noise,
                self.acceleration_noise,
            ]
        )
        covariances = response * densities[: len(state)] ** 2 @ np.swapaxes(response, 1, 2)
        return np.tensordot(dt_s / 2 * weights, covariances, axes=1)


def _decay(
    rate: FloatArray,  # per second
    damping_hz: float,
    dt_s: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the integral of a decaying rate over dt, and the rate after dt."""
    if damping_hz == 0:
        return rate * dt_s, rate
    remaining = np.exp(-damping_hz * dt_s)
    return rate * (1 - remaining) / damping_hz, rate * remaining
