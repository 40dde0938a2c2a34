"""How a vehicle moves on its plane between two instants: constant turn rate, with or without acceleration.

State [..., n]: x, z, yaw_rad, speed, turn rate (rad/s) and, with n = 6 instead of 5, acceleration. The camera stands
`lever_arm` ahead of the point that moves along its heading (the rear axle): in a turn it swings sideways. Turn rate
and acceleration decay exponentially. The chord of an arc is written with sinc, so nothing is singular without a turn.
Leading axes are free, so that one filter or thousands run through the same lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.types import FloatArray

X, Z, YAW, SPEED, TURN, ACCELERATION = range(6)
NUM_STATES = 6


@dataclass(frozen=True)
class VehicleModel:
    """Constants of the motion and of its noise; spectral densities are per square root of a second."""

    turn_damping_hz: float  # the turn rate falls by 1/e in 1 / turn_damping_hz seconds
    acceleration_damping_hz: float
    lever_arm: float
    slip_noise: float  # m / sqrt(s), of the position
    speed_noise: float  # m/s / sqrt(s)
    turn_noise: float  # rad/s / sqrt(s)
    acceleration_noise: float  # m/s^2 / sqrt(s); 0 for a model without acceleration

    def moved(
        self,
        state: FloatArray,  # [..., n]
        dt_s: FloatArray | float,  # [...]
    ) -> FloatArray:
        """The state [..., n] a moment later."""
        num_states = state.shape[-1]
        acceleration = state[..., ACCELERATION] if num_states > ACCELERATION else np.zeros_like(state[..., SPEED])
        turned, turn = _decayed(state[..., TURN], self.turn_damping_hz, dt_s)
        gained, acceleration = _decayed(acceleration, self.acceleration_damping_hz, dt_s)
        yaw, speed = state[..., YAW], state[..., SPEED]
        stops = speed * (speed + gained) < 0  # braking ends at rest, it does not reverse
        later_speed = np.where(stops, 0.0, speed + gained)
        chord = 0.5 * (speed + later_speed) * dt_s * np.sinc(turned / (2 * np.pi))
        middle, later_yaw = yaw + turned / 2, yaw + turned
        swing_x = self.lever_arm * (np.sin(later_yaw) - np.sin(yaw))
        swing_z = self.lever_arm * (np.cos(later_yaw) - np.cos(yaw))
        later = np.stack(
            [
                state[..., X] + chord * np.sin(middle) + swing_x,
                state[..., Z] + chord * np.cos(middle) + swing_z,
                later_yaw,
                later_speed,
                turn,
                np.where(stops, 0.0, acceleration),
            ],
            axis=-1,
        )
        return later[..., :num_states]

    def jacobian(
        self,
        state: FloatArray,  # [..., n]
        dt_s: FloatArray | float,  # [...]
    ) -> FloatArray:
        """Derivative of `moved` by the state [..., n, n], by central differences."""
        step = 1e-5
        nudges = step * np.eye(state.shape[-1])  # one state each
        dt_s = np.asarray(dt_s)[..., None]
        later = self.moved(state[..., None, :] + nudges, dt_s) - self.moved(state[..., None, :] - nudges, dt_s)
        return np.swapaxes(later, -1, -2) / (2 * step)

    def noise(
        self,
        state: FloatArray,  # [..., n]
        dt_s: FloatArray | float,  # [...]
    ) -> FloatArray:
        """Covariance [..., n, n] that white noise adds in dt: two short steps add what one long step does."""
        yaw, unit = state[..., YAW], np.eye(NUM_STATES)
        ahead = np.sin(yaw)[..., None] * unit[X] + np.cos(yaw)[..., None] * unit[Z]
        side = np.cos(yaw)[..., None] * unit[X] - np.sin(yaw)[..., None] * unit[Z]
        turning = side * self.lever_arm + unit[YAW]
        drifting = side * state[..., SPEED, None]
        chains = (  # noise enters the first entry, time integrates it into the next
            (self.slip_noise * ahead,),
            (self.slip_noise * side,),
            (self.speed_noise * unit[SPEED], self.speed_noise * ahead),
            (self.turn_noise * unit[TURN], self.turn_noise * turning, self.turn_noise * drifting),
            tuple(self.acceleration_noise * entry for entry in (unit[ACCELERATION], unit[SPEED], ahead)),
        )
        entries = [np.broadcast_to(entry, ahead.shape) for chain in chains for entry in chain]
        gains = np.stack(entries, axis=-2)[..., : state.shape[-1]]  # [..., 10, n]
        lengths = tuple(len(chain) for chain in chains)
        return np.swapaxes(gains, -1, -2) @ _integrals(lengths, dt_s) @ gains


def _decayed(rate: FloatArray, damping_hz: float, dt_s: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """The integral of a decaying rate over dt, and the rate after it."""
    kept = np.exp(-damping_hz * np.asarray(dt_s))
    share = -np.expm1(-damping_hz * np.asarray(dt_s)) / damping_hz if damping_hz > 0 else np.asarray(dt_s)
    return rate * share, rate * kept


def _integrals(lengths: tuple[int, ...], dt_s: FloatArray | float) -> FloatArray:
    """Integrals over dt of t^i / i! * t^j / j! between the members of each chain of integrators, [..., N, N]."""
    dt = np.asarray(dt_s, dtype=np.float64)[..., None, None]
    order = np.concatenate([np.arange(length) for length in lengths])
    chain = np.repeat(np.arange(len(lengths)), lengths)
    factorial = np.array([1.0, 1.0, 2.0])[order]
    power = order[:, None] + order + 1
    same = chain[:, None] == chain
    return np.where(same, dt**power / (power * factorial[:, None] * factorial), 0.0)
