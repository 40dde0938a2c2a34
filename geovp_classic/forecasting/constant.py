"""Extrapolate a trajectory: say where the camera will be from where it was, at any future time stamps.

All forecasters here are deterministic: further samples are copies. With fewer than two past poses there is no motion to
continue, and they hold the last pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory


@dataclass(frozen=True)
class Hold:
    """The camera stays where it was last."""

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4], all equal to the last pose."""
        ahead_s = _seconds_ahead(past, times_s)
        return _copies(np.broadcast_to(past.world_from_cam[-1], (len(ahead_s), 4, 4)), num_samples)


@dataclass(frozen=True)
class ConstantVelocity:
    """The camera goes on in a straight line at its last velocity, without turning.

    The velocity is that of the last `num_steps` steps together, or of as many as there are.
    """

    num_steps: int = 1

    def __post_init__(self) -> None:
        """Raise BadData for a number of steps below one."""
        _check_num_steps(self.num_steps)

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4] with the last orientation."""
        ahead_s = _seconds_ahead(past, times_s)
        recent = past[-1 - self.num_steps :] if len(past) > self.num_steps else past
        positions = recent.world_from_cam[:, :3, 3]
        duration_s = recent.times_s[-1] - recent.times_s[0]
        velocity = (positions[-1] - positions[0]) / duration_s if duration_s > 0 else np.zeros(3)
        futures = np.tile(past.world_from_cam[-1], (len(ahead_s), 1, 1))
        futures[:, :3, 3] += ahead_s[:, None] * velocity
        return _copies(futures, num_samples)


@dataclass(frozen=True)
class ConstantTurn:
    """The camera keeps its last twist, translation and rotation in its own frame: circles stay circles.

    The twist per second is the mean over the last `num_steps` steps, or over as many as there are, each step weighted
    by its duration.
    """

    num_steps: int = 1

    def __post_init__(self) -> None:
        """Raise BadData for a number of steps below one."""
        _check_num_steps(self.num_steps)

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4] on the screw motion through the last pose."""
        ahead_s = _seconds_ahead(past, times_s)
        recent = past[-1 - self.num_steps :] if len(past) > self.num_steps else past
        steps = se3.inverse(recent.world_from_cam[:-1]) @ recent.world_from_cam[1:]
        duration_s = recent.times_s[-1] - recent.times_s[0]
        twist_per_s = se3.log(steps).sum(axis=0) / duration_s if duration_s > 0 else np.zeros(6)
        futures = past.world_from_cam[-1] @ se3.exp(ahead_s[:, None] * twist_per_s)
        return _copies(futures, num_samples)


def _seconds_ahead(past: Trajectory, times_s: FloatArray) -> FloatArray:
    """The future times [F], counted from the last past pose."""
    if len(past) == 0:
        raise BadData("a forecast from no past pose at all: give it at least one")
    return np.asarray(times_s, dtype=np.float64) - past.times_s[-1]


def _copies(futures: FloatArray, num_samples: int) -> FloatArray:
    """[F, 4, 4] to [S, F, 4, 4]."""
    return np.tile(futures, (num_samples, 1, 1, 1))


def _check_num_steps(num_steps: int) -> None:
    if num_steps < 1:
        raise BadData(f"num_steps is {num_steps}, expected 1 or more: the steps whose motion is averaged")
