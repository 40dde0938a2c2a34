"""Motion models of a vehicle on its plane: constant turn rate with constant speed (CTRV) or
acceleration (CTRA).

State [..., n]: x, z, yaw_rad, speed, turn rate (rad/s) and, in CTRA, acceleration. The camera
stands `lever_arm` ahead of the point that moves along its heading (the rear axle): in a turn it
swings sideways. Turn rate and acceleration decay exponentially. The chord of an arc is written with
sinc, so nothing is singular without a turn. Leading axes are free: one state or thousands.
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.types import FloatArray

X, Z, YAW, SPEED, TURN, ACCELERATION = range(6)


@dataclass(frozen=True)
class VehicleModel:
    """Constants of the motion, spectral densities of its process noise, deviations of the
    measurement noise.
    """

    turn_damping_hz: float  # the turn rate falls by 1/e in 1 / turn_damping_hz seconds
    acceleration_damping_hz: float
    lever_arm: float  # m
    slip_noise: float  # m / sqrt(s), of the position
    speed_noise: float  # m/s / sqrt(s)
    turn_noise: float  # rad/s / sqrt(s)
    acceleration_noise: float  # m/s^2 / sqrt(s); 0 for a model without acceleration
    position_noise_m: float = 0.01
    yaw_noise_rad: float = 0.001

    @property
    def num_states(self) -> int:
        """5 for CTRV, 6 for CTRA."""
        return 6 if self.acceleration_noise > 0 else 5

    @property
    def measurement_noise(self) -> FloatArray:
        """The covariance [3, 3] of a measured (x, z, yaw)."""
        return np.diag(
            np.square([self.position_noise_m, self.position_noise_m, self.yaw_noise_rad])
        )

    def transition(self, state: FloatArray, dt_s: FloatArray | float) -> FloatArray:
        """The state [..., n] after dt [...]."""
        dt_s = np.asarray(dt_s)
        acceleration = (
            state[..., ACCELERATION]
            if state.shape[-1] > ACCELERATION
            else np.zeros_like(state[..., SPEED])
        )
        turned, turn = _decayed(state[..., TURN], self.turn_damping_hz, dt_s)
        gained, acceleration = _decayed(acceleration, self.acceleration_damping_hz, dt_s)
        yaw, speed = state[..., YAW], state[..., SPEED]
        stops = speed * (speed + gained) < 0  # braking ends at rest, it does not reverse
        later_speed, later_yaw = np.where(stops, 0.0, speed + gained), yaw + turned
        chord = 0.5 * (speed + later_speed) * dt_s * np.sinc(turned / (2 * np.pi))
        later = [
            state[..., X]
            + chord * np.sin(yaw + turned / 2)
            + self.lever_arm * (np.sin(later_yaw) - np.sin(yaw)),
            state[..., Z]
            + chord * np.cos(yaw + turned / 2)
            + self.lever_arm * (np.cos(later_yaw) - np.cos(yaw)),
            later_yaw,
            later_speed,
            turn,
            np.where(stops, 0.0, acceleration),
        ]
        return np.stack(later, axis=-1)[..., : state.shape[-1]]

    def jacobian(self, state: FloatArray, dt_s: FloatArray | float) -> FloatArray:
        """Derivative of `transition` by the state [..., n, n], by central differences."""
        step = 1e-5
        shifts = step * np.eye(state.shape[-1])  # one state each
        dt_s, state = np.asarray(dt_s)[..., None], state[..., None, :]
        later = self.transition(state + shifts, dt_s) - self.transition(state - shifts, dt_s)
        return np.swapaxes(later, -1, -2) / (2 * step)

    def process_noise(self, state: FloatArray, dt_s: FloatArray | float) -> FloatArray:
        """Covariance [..., n, n] that white noise adds in dt: two short steps add what one long
        step does.
        """
        yaw, unit = state[..., YAW], np.eye(6)
        ahead = np.sin(yaw)[..., None] * unit[X] + np.cos(yaw)[..., None] * unit[Z]
        side = np.cos(yaw)[..., None] * unit[X] - np.sin(yaw)[..., None] * unit[Z]
        turning = side * self.lever_arm + unit[YAW]
        drifting = side * state[..., SPEED, None]
        chains = (  # noise enters the first entry, time integrates it into the next
            (self.slip_noise * ahead,),
            (self.slip_noise * side,),
            (self.speed_noise * unit[SPEED], self.speed_noise * ahead),
            (self.turn_noise * unit[TURN], self.turn_noise * turning, self.turn_noise * drifting),
            tuple(
                self.acceleration_noise * entry
                for entry in (unit[ACCELERATION], unit[SPEED], ahead)
            ),
        )
        entries = [np.broadcast_to(entry, ahead.shape) for chain in chains for entry in chain]
        gains = np.stack(entries, axis=-2)[..., : state.shape[-1]]  # [..., 10, n]
        lengths = tuple(len(chain) for chain in chains)
        return np.swapaxes(gains, -1, -2) @ _integrals(lengths, dt_s) @ gains


def _decayed(
    rate: FloatArray, damping_hz: float, dt_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The integral of a decaying rate over dt, and the rate after it."""
    share = -np.expm1(-damping_hz * dt_s) / damping_hz if damping_hz > 0 else dt_s
    return rate * share, rate * np.exp(-damping_hz * dt_s)


def _integrals(lengths: tuple[int, ...], dt_s: FloatArray | float) -> FloatArray:
    """Integrals over dt of t^i / i! * t^j / j! between the members of each chain of integrators,
    [..., N, N].
    """
    dt = np.asarray(dt_s, dtype=np.float64)[..., None, None]
    order = np.concatenate([np.arange(length) for length in lengths])
    chain = np.repeat(np.arange(len(lengths)), lengths)
    factorial = np.array([1.0, 1.0, 2.0])[order]
    power = order[:, None] + order + 1
    return np.where(
        chain[:, None] == chain, dt**power / (power * factorial[:, None] * factorial), 0.0
    )
