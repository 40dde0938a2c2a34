"""Motion models of a vehicle: constant turn rate, and constant speed (CTRV) or acceleration (CTRA).

The state [..., n] is x, z, yaw_rad, speed, turn rate (rad/s) and, in CTRA, acceleration. Turn rate
and acceleration decay exponentially; braking ends at rest. Leading axes are free: one state or
thousands.
"""

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.types import FloatArray

NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)  # of Gauss-Legendre quadrature over [-1, 1]


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
    # of the measured poses; odometry of KITTI is off by about 1 cm and 0.05 degrees per frame
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
        x, z, yaw, speed, turn_rate = np.moveaxis(state[..., :5], -1, 0)
        acceleration = state[..., 5] if state.shape[-1] == 6 else np.zeros_like(speed)
        # Braking ends at rest: the vehicle moves until its speed is 0, or for all of dt.
        stopping_s = self._stopping_s(speed, acceleration)
        moving_s = np.minimum(dt_s, stopping_s)
        end_speed = self._speed(speed, acceleration, moving_s)
        # A speed that rounding has reversed is 0, too.
        is_stopped = (stopping_s <= dt_s) | (end_speed * speed < 0)
        # Speed, distance and yaw are integrals over the time of moving (Gauss-Legendre).
        at_s = moving_s[..., None] / 2 * (1 + NODES)  # [..., 3]
        weights_s = moving_s[..., None] / 2 * WEIGHTS
        speed_at = self._speed(speed[..., None], acceleration[..., None], at_s)
        distance = (weights_s * speed_at).sum(axis=-1)
        turn_rate_at = self._turn_rate(turn_rate[..., None], speed[..., None], speed_at, at_s)
        turn = (weights_s * turn_rate_at).sum(axis=-1)
        # The rear axle moves along the chord of its arc, and the camera swings ahead of it.
        end_yaw = yaw + turn
        chord_yaw = yaw + turn / 2
        chord = distance * np.sinc(turn / (2 * np.pi))
        swing_x = self.lever_arm_m * (np.sin(end_yaw) - np.sin(yaw))
        swing_z = self.lever_arm_m * (np.cos(end_yaw) - np.cos(yaw))
        end_x = x + chord * np.sin(chord_yaw) + swing_x
        end_z = z + chord * np.cos(chord_yaw) + swing_z
        # A vehicle at rest neither turns nor accelerates.
        end_speed = np.where(is_stopped, 0.0, end_speed)
        end_turn_rate = self._turn_rate(turn_rate, speed, end_speed, moving_s)
        remaining = np.exp(-self.acceleration_damping_hz * moving_s)
        end_acceleration = np.where(is_stopped, 0.0, acceleration * remaining)
        end = [end_x, end_z, end_yaw, end_speed, end_turn_rate, end_acceleration]
        return np.stack(end, axis=-1)[..., : state.shape[-1]]

    def _speed(
        self,
        speed: FloatArray,
        acceleration: FloatArray,
        dt_s: FloatArray,
    ) -> FloatArray:
        """Return the speed after dt at an exponentially decaying acceleration."""
        damping_hz = self.acceleration_damping_hz
        decayed_s = dt_s if damping_hz == 0 else -np.expm1(-damping_hz * dt_s) / damping_hz
        return speed + acceleration * decayed_s

    def _turn_rate(
        self,
        turn_rate: FloatArray,
        speed: FloatArray,
        end_speed: FloatArray,
        dt_s: FloatArray,
    ) -> FloatArray:
        """Return the turn rate after dt, when the speed has changed to another.

        Braking keeps the path's curvature, turn rate / speed. Speeding up keeps the turn rate:
        drivers accelerate as they leave a turn, and at rest the curvature is unknown.
        """
        is_slower = np.abs(end_speed) < np.abs(speed)
        slowdown = np.where(is_slower, end_speed / np.where(speed == 0, 1.0, speed), 1.0)
        return turn_rate * np.exp(-self.turn_damping_hz * dt_s) * slowdown

    def _stopping_s(
        self,
        speed: FloatArray,
        acceleration: FloatArray,
    ) -> FloatArray:
        """Return the time after which braking ends at rest; inf if it does not."""
        # Weaker braking takes longer than any forecast.
        is_braking = (speed * acceleration < 0) & (np.abs(acceleration) > 1e-9)
        undamped_s = -speed / np.where(is_braking, acceleration, 1.0)
        if self.acceleration_damping_hz == 0:
            return np.where(is_braking, undamped_s, np.inf)
        # Solve speed + acceleration * (1 - remaining) / damping = 0.
        remaining = 1.0 - self.acceleration_damping_hz * undamped_s  # of the acceleration
        stopping_s = -np.log(np.maximum(remaining, 1e-300)) / self.acceleration_damping_hz
        return np.where(is_braking & (remaining > 0), stopping_s, np.inf)

    def jacobian(
        self,
        state: FloatArray,  # [..., n]
        dt_s: FloatArray | float,
    ) -> FloatArray:
        """Return the derivative of `transition` by the state [..., n, n] (central differences)."""
        step = 1e-5
        num_states = state.shape[-1]
        shifts = step * np.concatenate([np.eye(num_states), -np.eye(num_states)])
        moved = self.transition(state[..., None, :] + shifts, np.asarray(dt_s)[..., None])
        above, below = np.split(moved, 2, axis=-2)
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
        undamped = replace(self, turn_damping_hz=0.0, acceleration_damping_hz=0.0)
        states = np.tile(state, (3, 1))
        response = undamped.jacobian(states, dt_s / 2 * (1 + NODES))  # [3, n, n]
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
        return np.tensordot(dt_s / 2 * WEIGHTS, covariances, axes=1)
