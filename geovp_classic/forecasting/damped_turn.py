"""Damped turn in SE(3): a Kalman filter of the camera's twist, without a vehicle.

Each component of the twist is a steady part plus a transient part. The transient part is an
Ornstein-Uhlenbeck process: a hand that shakes returns to its mean, so that the forecast averages
over the past and the last deviation decays.
"""

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory


@dataclass(frozen=True)
class DampedTurn:
    """Forecaster by a Kalman filter whose noise is learnt from the observed twists themselves."""

    # Time in which a deviation from the steady motion falls by 1/e; chosen on 16 field videos among
    # .25 and .5: about one step of a walker
    transient_s: float = 0.5
    # Times in which the steady motion falls by 1/e (inf: never). A pan ends sooner than a walk;
    # chosen on the same videos among 2 s and inf, and .5, 1 and 2 s.
    translation_s: float = np.inf
    rotation_s: float = 2.0
    # Fraction of the twists' variance that is measurement noise; .1 to .6 are as good
    noise_fraction: float = 0.3
    # Noise of a twist relative to the largest twist; keeps a uniform motion well-posed
    min_noise_ratio: float = 1e-3

    def __post_init__(self) -> None:
        times_s = (self.transient_s, self.translation_s, self.rotation_s)
        if not min(times_s) > 0:
            raise BadData(f"damped-turn: times of decay are {times_s}, expected positive seconds")

    def forecast(
        self,
        past: Trajectory,
        times_s: FloatArray,  # [F]
        num_samples: int = 1,
    ) -> FloatArray:
        """Return futures [S, F, 4, 4], all equal."""
        last = past.world_from_cam[-1]
        ahead_s = times_s - past.times_s[-1]
        if len(past) == 1:
            return np.tile(last, (num_samples, len(times_s), 1, 1))
        steady, transient = self.filtered(past)
        # The decaying parts are integrated in closed form: their axes hardly turn meanwhile.
        steady_s = np.repeat([self.translation_s, self.rotation_s], 3)
        twists = steady * _decayed_time(ahead_s, steady_s)
        twists += transient * _decayed_time(ahead_s, np.full(6, self.transient_s))
        return np.tile(last @ se3.exp(twists), (num_samples, 1, 1, 1))

    def filtered(self, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return the steady and the transient twist per second [6] at the last of >= 2 poses."""
        steps_s = np.diff(past.times_s)
        twists = se3.log(se3.steps(past.world_from_cam)) / steps_s[:, None]
        # Learn the noise: the spread around the mean is transient motion and measurement noise.
        max_rate = np.repeat(np.abs(twists).reshape(-1, 2, 3).max(axis=(0, 2)), 3)
        floor = (self.min_noise_ratio * max_rate + 1e-9) ** 2
        variance = twists.var(axis=0) + floor
        transient_variance = (1 - self.noise_fraction) * variance
        # The state [12] is the steady part, with a prior around 0, and the transient part.
        kalman = KalmanFilter(dim_x=12, dim_z=6)
        kalman.x = np.zeros(12)
        kalman.P = np.diag(np.concatenate([(twists**2).mean(axis=0) + floor, transient_variance]))
        kalman.H = np.hstack([np.eye(6), np.eye(6)])
        kalman.R = np.diag(self.noise_fraction * variance)
        for step, dt_s in enumerate(steps_s):
            remaining = np.exp(-dt_s / self.transient_s)
            innovation = (1 - remaining**2) * transient_variance
            kalman.predict(
                F=np.diag(np.repeat([1.0, remaining], 6)),
                Q=np.diag(np.concatenate([np.zeros(6), innovation])),
            )
            kalman.update(twists[step])
        return kalman.x[:6], kalman.x[6:]


def _decayed_time(
    ahead_s: FloatArray,  # [F]
    decay_s: FloatArray,  # [6]; inf: no decay
) -> FloatArray:
    """Return the integrals [F, 6] of exponential decays from 1, in seconds."""
    rate_hz = 1 / decay_s
    return np.where(
        rate_hz == 0,
        ahead_s[:, None],
        -np.expm1(-ahead_s[:, None] * rate_hz) / np.where(rate_hz == 0, 1.0, rate_hz),
    )
