"""Forecasters that repeat the last motion: none, the velocity, or the whole twist.

They are deterministic: further samples are copies. After a single pose they hold it.
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory


@dataclass(frozen=True)
class Hold:
    """Forecaster that keeps the last pose."""

    def forecast(
        self,
        past: Trajectory,
        times_s: FloatArray,  # [F]
        num_samples: int = 1,
    ) -> FloatArray:
        """Return futures [S, F, 4, 4], all equal to the last pose."""
        return np.tile(past.world_from_cam[-1], (num_samples, len(times_s), 1, 1))


@dataclass(frozen=True)
class _RecentMotion:
    num_steps: int = 1  # whose motion is averaged; 1 is right for poses without noise

    def __post_init__(self) -> None:
        if self.num_steps < 1:
            raise BadData(f"num_steps is {self.num_steps}, expected 1 or more steps to average")

    def _recent(self, past: Trajectory) -> tuple[FloatArray, float]:
        """Return the poses [N, 4, 4] of the last steps, and their duration in seconds."""
        first = max(len(past) - 1 - self.num_steps, 0)
        duration_s = past.times_s[-1] - past.times_s[first] or np.inf  # of a single pose
        return past.world_from_cam[first:], duration_s


class ConstantVelocity(_RecentMotion):
    """Forecaster at the mean velocity of the last `num_steps` steps, without turning."""

    def forecast(
        self,
        past: Trajectory,
        times_s: FloatArray,  # [F]
        num_samples: int = 1,
    ) -> FloatArray:
        """Return futures [S, F, 4, 4], all equal and with the last rotation."""
        recent, duration_s = self._recent(past)
        velocity = (recent[-1, :3, 3] - recent[0, :3, 3]) / duration_s
        futures = Hold().forecast(past, times_s, num_samples)
        futures[..., :3, 3] += (times_s[:, None] - past.times_s[-1]) * velocity
        return futures


class ConstantTurn(_RecentMotion):
    """Forecaster that keeps the twist in the camera's frame, so that circles stay circles.

    The twist per second is the mean over the last `num_steps` steps, weighted by their duration.
    """

    def forecast(
        self,
        past: Trajectory,
        times_s: FloatArray,  # [F]
        num_samples: int = 1,
    ) -> FloatArray:
        """Return futures [S, F, 4, 4], all equal."""
        recent, duration_s = self._recent(past)
        twist_per_s = se3.log(se3.steps(recent)).sum(axis=0) / duration_s
        future = recent[-1] @ se3.exp((times_s[:, None] - past.times_s[-1]) * twist_per_s)
        return np.tile(future, (num_samples, 1, 1, 1))
