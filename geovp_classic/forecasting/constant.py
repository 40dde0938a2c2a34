"""Forecasters that repeat the last motion: none, the velocity, or the whole twist.

All are deterministic: further samples are copies. With fewer than two past poses there is no motion
to repeat, and they hold the last pose.
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.forecasting.past_motion import seconds_ahead
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory


@dataclass(frozen=True)
class Hold:
    """The camera stays where it was last."""

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4], all equal to the last pose."""
        return np.tile(
            past[-1:].world_from_cam, (num_samples, len(seconds_ahead(past, times_s)), 1, 1)
        )


@dataclass(frozen=True)
class _RecentMotion:
    num_steps: int = 1

    def __post_init__(self) -> None:
        if self.num_steps < 1:
            raise BadData(
                f"num_steps is {self.num_steps}, expected 1 or more: the steps whose motion is "
                "averaged"
            )

    def _recent(self, past: Trajectory) -> tuple[Trajectory, float]:
        """The last steps, or as many as there are, and their duration in seconds (infinite when
        there is none).
        """
        recent = past[-1 - self.num_steps :] if len(past) > self.num_steps else past
        return recent, recent.times_s[-1] - recent.times_s[0] or np.inf


class ConstantVelocity(_RecentMotion):
    """The camera goes on in a straight line at the mean velocity of the last `num_steps` steps,
    without turning.
    """

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4] with the last orientation."""
        ahead_s = seconds_ahead(past, times_s)
        recent, duration_s = self._recent(past)
        positions = recent.world_from_cam[:, :3, 3]
        futures = np.tile(past.world_from_cam[-1], (num_samples, len(ahead_s), 1, 1))
        futures[..., :3, 3] += ahead_s[:, None] * (positions[-1] - positions[0]) / duration_s
        return futures


class ConstantTurn(_RecentMotion):
    """The camera keeps its twist, translation and rotation in its own frame: circles stay circles.

    The twist per second is the mean over the last `num_steps` steps, each weighted by its duration.
    """

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4] on the screw motion through the last pose."""
        ahead_s = seconds_ahead(past, times_s)
        recent, duration_s = self._recent(past)
        steps = se3.inverse(recent.world_from_cam[:-1]) @ recent.world_from_cam[1:]
        twist_per_s = se3.log(steps).sum(axis=0) / duration_s
        futures = past.world_from_cam[-1] @ se3.exp(ahead_s[:, None] * twist_per_s)
        return np.tile(futures, (num_samples, 1, 1, 1))
