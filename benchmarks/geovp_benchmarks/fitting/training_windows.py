"""Training windows of forecasters, and their augmentation."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.past_motion import Axis
from geovp_classic.geometry import planar, se3
from geovp_classic.types import BoolArray, FloatArray, IntArray, Trajectory

STEP_S = 0.1037  # KITTI's frame interval
StatesOf = Callable[[FloatArray, Trajectory], FloatArray]  # of future poses [F, 4, 4] and the past


@dataclass(frozen=True)
class TrainingWindows:
    """N pasts with their futures."""

    twists: FloatArray  # [N, P, 6], per second
    states: FloatArray  # [N, F, 3]

    def __len__(self) -> int:
        return len(self.twists)

    def __getitem__(self, selection: IntArray | slice) -> TrainingWindows:
        return TrainingWindows(self.twists[selection], self.states[selection])

    @staticmethod
    def concatenated(parts: Iterable[TrainingWindows]) -> TrainingWindows:
        """Return the windows of all parts, in their order."""
        parts = list(parts)
        twists = np.concatenate([part.twists for part in parts])
        states = np.concatenate([part.states for part in parts])
        return TrainingWindows(twists, states)


def states_on_plane(
    world_from_cam: FloatArray,  # [F, 4, 4]
    past: Trajectory,
) -> FloatArray:
    """Return (x, z, yaw) [F, 3] on the plane along which the camera has travelled."""
    plane = past_motion.vehicle_from_cam(past)
    return planar.reduce(world_from_cam, past.world_from_cam[-1], plane)


@dataclass(frozen=True)
class Grid:
    """Time grid of training windows."""

    num_past: int = 9
    num_future: int = 21  # a little more than 20 frames with jittering times
    stride: int = 2  # frames between two windows

    def windows(
        self,
        trajectory: Trajectory,
        states_of: StatesOf = states_on_plane,
        usable: BoolArray | None = None,  # [T - 1], steps that a window may contain
    ) -> TrainingWindows:
        """Cut all windows of a trajectory."""
        ahead_s = STEP_S * np.arange(1, self.num_future + 1)
        twists = []
        states = []
        for last in range(self.num_past, len(trajectory), self.stride):
            times_s = trajectory.times_s[last] + ahead_s
            if times_s[-1] > trajectory.times_s[-1]:
                break
            first = last - self.num_past
            end = np.searchsorted(trajectory.times_s, times_s[-1])
            if usable is not None and not usable[first:end].all():
                continue
            past = trajectory[first : last + 1]
            future = se3.interpolate(trajectory.world_from_cam, trajectory.times_s, times_s)
            twists.append(past_motion.twists_per_s(past, STEP_S, self.num_past))
            states.append(states_of(future, past))
        return TrainingWindows(
            np.reshape(twists, (-1, self.num_past, 6)),
            np.reshape(states, (-1, self.num_future, 3)),
        )


@dataclass(frozen=True)
class Augmentation:
    """Windows at other speeds, and with the errors of odometry."""

    rescaled_fraction: float = 0.4  # of the windows
    log_rescaling: tuple[float, float] = (-0.2, 0.8)  # town drives become motorway drives
    position_noise_m: float = 0.02  # per step, at noise level 1
    rotation_noise_deg: float = 0.05
    noise_levels: tuple[float, float] = (0.05, 2.0)
    noisy_fraction: float = 0.5
    short_fraction: float = 0.25

    @property
    def noise_per_s(self) -> FloatArray:
        """Standard deviation [6] of a twist per second at noise level 1."""
        rotation_noise_rad = np.radians(self.rotation_noise_deg)
        return np.repeat([self.position_noise_m, rotation_noise_rad], 3) / STEP_S

    def rescaled(
        self,
        windows: TrainingWindows,
        rng: np.random.Generator,
    ) -> TrainingWindows:
        """Return windows of which a fraction is driven faster on a longer path of the same turns.

        Recorded speeds end at 15 m/s, and a monocular scale may be wrong.
        """
        count = len(windows)
        factor = np.exp(rng.uniform(*self.log_rescaling, count))
        factor[rng.random(count) >= self.rescaled_fraction] = 1.0
        twists = windows.twists.copy()
        twists[..., : Axis.PITCH] *= factor[:, None, None]
        states = windows.states.copy()
        states[..., :2] *= factor[:, None, None]
        return TrainingWindows(twists, states)

    def corrupted(
        self,
        twists: FloatArray,  # [N, P, 6], per second
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return past twists [N, P, 6] of which some are noisy and some are short."""
        count, num_steps, _ = twists.shape
        lowest, highest = np.log(self.noise_levels)
        level = np.exp(rng.uniform(lowest, highest, count))
        level[rng.random(count) >= self.noisy_fraction] = 0.0
        noise = self.noise_per_s * rng.standard_normal(twists.shape)
        num_recorded = rng.integers(1, num_steps + 1, count)
        num_recorded[rng.random(count) >= self.short_fraction] = num_steps
        return shortened(twists + level[:, None, None] * noise, num_recorded)


def with_stationary(
    windows: TrainingWindows,
    fraction: float,
) -> TrainingWindows:
    """Add a fraction of windows of a stationary car; recordings are cut where the car waits."""
    count = int(np.ceil(fraction * len(windows)))
    twists = np.zeros((count, *windows.twists.shape[1:]))
    states = np.zeros((count, *windows.states.shape[1:]))
    return TrainingWindows.concatenated([windows, TrainingWindows(twists, states)])


def shortened(
    twists: FloatArray,  # [N, P, 6]
    num_recorded: IntArray,  # [N]
) -> FloatArray:
    """Return the last recorded twists, the first of them repeated for the steps before."""
    num_steps = twists.shape[1]
    steps = np.maximum(np.arange(num_steps), (num_steps - num_recorded)[:, None])
    return np.take_along_axis(twists, steps[..., None], axis=1)
