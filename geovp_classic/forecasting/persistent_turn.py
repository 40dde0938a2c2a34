"""Persistent turn in SE(3): the mean motion, as far as it was steady, and the end of its sway.

A motion that changed little from step to step goes on; one that changed as much as it moved, like
the rotations of a hand that shakes, is expected to return to zero. The forecast of each rate is its
mean times mean^2 / (mean^2 + variance), the linear estimate with the least mean square error of
a future rate with this mean and variance (Wiener 1949).

At present the rates are others. They do not change at once: the camera swings on, and then back to
its mean path, like a critically damped oscillator that gets the difference v of the rates as its
velocity at rest: x'' + 2 x' / T + x / T^2 = 0 with x(0) = 0 and x'(0) = v has x(t) = v t exp(-t/T).
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.forecasting.constant import Hold
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory


@dataclass(frozen=True)
class PersistentTurn:
    """Forecaster of any camera: a constant twist, shrunk by the variance of the observed twists.

    The difference of the present twist from it fades as the end of a sway.
    """

    # Age in which the weight of an observed twist falls by half. Chosen on videos of other cameras
    # and on KITTI's train and val, where .15 and .4 s differ by .1 dB.
    half_life_s: float = 0.2
    # Of the variance. Chosen on videos of other cameras, where the LPIPS of 1 and 4 is that of 2
    # plus .002 and minus .003, and 8 differs little from 4; on KITTI's val, 4 gains .12 dB over 2.
    variance_factor: float = 4.0
    num_steps: int = 9  # the last ones; older twists have no weight at this half-life
    # Of the weights of the present rates: at 30 frames per second, their noise is averaged over
    # some steps, at 10 the last one has three quarters of the weight
    present_half_life_s: float = 0.05
    # Time after which a sway is widest. Chosen among .15 to .6 s by the poses of 43 videos of other
    # cameras; .2 and .4 differ little from it.
    sway_s: float = 0.3

    def __post_init__(self) -> None:
        times_s = self.half_life_s, self.present_half_life_s, self.sway_s
        if not (min(times_s) > 0 and self.variance_factor >= 0 and self.num_steps >= 1):
            raise BadData(
                f"persistent-turn: half_life_s, present_half_life_s and sway_s are {times_s}, "
                f"variance_factor {self.variance_factor} and num_steps {self.num_steps}, expected "
                "positive times, a factor of 0 or more and 1 step or more"
            )

    def forecast(
        self,
        past: Trajectory,
        times_s: FloatArray,  # [F]
        num_samples: int = 1,
    ) -> FloatArray:
        """Return futures [S, F, 4, 4], all equal."""
        last = past.world_from_cam[-1]
        if len(past) == 1:
            return Hold().forecast(past, times_s, num_samples)
        # The expected motion goes on, and the present one swings back to it
        expected_per_s, present_per_s = self.twists_per_s(past)
        ahead_s = times_s[:, None] - past.times_s[-1]
        sway = ahead_s * np.exp(-ahead_s / self.sway_s) * (present_per_s - expected_per_s)
        future = last @ se3.exp(ahead_s * expected_per_s + sway)
        return np.tile(future, (num_samples, 1, 1, 1))

    def twists_per_s(self, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return the expected twist [6] of the future and the present one, in the camera's frame.

        The past has two poses or more.
        """
        recent = past[slice(-self.num_steps - 1, None)]
        steps_s = np.diff(recent.times_s)
        twists = se3.log(se3.steps(recent.world_from_cam)) / steps_s[:, None]
        age_s = recent.times_s[-1] - (recent.times_s[:-1] + recent.times_s[1:]) / 2

        def weights_of(half_life_s: float) -> FloatArray:
            # recent and long steps count more
            weights = steps_s * 0.5 ** ((age_s - age_s[-1]) / half_life_s)
            return np.asarray(weights / weights.sum())

        present = weights_of(self.present_half_life_s) @ twists

        # Weighted mean and unbiased variance
        weights = weights_of(self.half_life_s)
        mean = weights @ twists
        num_effective = 1 / (weights**2).sum()
        if num_effective <= 1:  # a single step has no variance
            return mean, present
        variance = weights @ (twists - mean) ** 2 / (1 - 1 / num_effective)

        # The translation is shrunk as a whole, so that its direction stays; each rotation by itself
        power = mean**2
        noise = self.variance_factor * variance
        power[:3], noise[:3] = power[:3].sum(), noise[:3].sum()
        return mean * power / np.maximum(power + noise, np.finfo(float).tiny), present
