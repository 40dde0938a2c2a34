"""Training windows of the motion prior: past twists with the states that followed, and their
augmentation.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.motion_prior import NUM_PAST_STEPS
from geovp_classic.geometry import planar
from geovp_classic.types import BoolArray, FloatArray, IntArray, Trajectory

STEP_S = 0.1037  # KITTI's frame interval
NUM_FUTURE_STEPS = 21  # a little more than 20 frames of jittering times
LOG_RESCALING = (-0.2, 0.8)  # from 0.8 to 2.2, so that town drives become motorway ones
POSITION_NOISE_M, ROTATION_NOISE_RAD = 0.02, np.radians(0.05)  # per step: noise level 1


@dataclass(frozen=True)
class TrainingWindows:
    """N pasts with their futures."""

    twists: FloatArray  # [N, P, 6], per second
    states: FloatArray  # [N, F, 3]

    def __len__(self) -> int:
        return len(self.twists)

    def __getitem__(self, which: IntArray | slice) -> TrainingWindows:
        return TrainingWindows(self.twists[which], self.states[which])

    @staticmethod
    def concatenated(parts: Iterable[TrainingWindows]) -> TrainingWindows:
        """All windows of the parts, in their order."""
        twists, states = zip(*((part.twists, part.states) for part in parts), strict=True)
        return TrainingWindows(np.concatenate(twists), np.concatenate(states))


def windows(
    trajectory: Trajectory, stride: int, usable: BoolArray | None = None
) -> TrainingWindows:
    """One window every `stride` frames of a sequence, where all its steps [N - 1] are usable."""
    twists: list[FloatArray] = [np.empty((0, NUM_PAST_STEPS, 6))]
    states: list[FloatArray] = [np.empty((0, NUM_FUTURE_STEPS, 3))]
    ahead_s = STEP_S * np.arange(1, NUM_FUTURE_STEPS + 1)
    for last in range(NUM_PAST_STEPS, len(trajectory), stride):
        times_s = trajectory.times_s[last] + ahead_s
        if times_s[-1] > trajectory.times_s[-1]:
            break
        first, end = last - NUM_PAST_STEPS, np.searchsorted(trajectory.times_s, times_s[-1])
        if usable is not None and not usable[first:end].all():
            continue
        past = trajectory[first : last + 1]
        twists.append(past_motion.twists_per_s(past, STEP_S, NUM_PAST_STEPS)[None])
        poses = past_motion.poses_at(trajectory, times_s)
        states.append(
            planar.reduce(poses, past.world_from_cam[-1], past_motion.vehicle_from_cam(past))[None]
        )
    return TrainingWindows(np.concatenate(twists), np.concatenate(states))


def with_standing(driven: TrainingWindows, share: float) -> TrainingWindows:
    """Windows, and as a share of them some of a car that stands still: sequences are cut where the
    car waits.
    """
    count = int(np.ceil(share * len(driven)))
    still = TrainingWindows(
        np.zeros((count, NUM_PAST_STEPS, 6)), np.zeros((count, NUM_FUTURE_STEPS, 3))
    )
    return TrainingWindows.concatenated([driven, still])


def rescaled(
    data: TrainingWindows, rng: np.random.Generator, share: float = 0.4
) -> TrainingWindows:
    """A share of the windows driven faster or slower along a longer or shorter path of the same
    turns.

    Recorded speeds end at 15 m/s; without this a motorway is an extrapolation, and so is a
    monocular scale error.
    """
    drawn = np.where(
        rng.random(len(data)) < share, np.exp(rng.uniform(*LOG_RESCALING, len(data))), 1.0
    )
    factors = drawn[:, None, None]
    twists = data.twists * np.where(np.arange(6) < 3, factors, 1.0)
    return TrainingWindows(twists, data.states * np.where(np.arange(3) < 2, factors, 1.0))


def corrupted(
    twists: FloatArray, rng: np.random.Generator, max_noise: float = 2.0, cut_share: float = 0.25
) -> FloatArray:
    """Past twists [N, P, 6] with the errors of odometry: half with noise of some level, a share of
    them short.
    """
    count = len(twists)
    levels = np.where(
        rng.random(count) < 0.5, 0.0, np.exp(rng.uniform(np.log(0.05), np.log(max_noise), count))
    )
    known = np.where(
        rng.random(count) < cut_share, rng.integers(1, NUM_PAST_STEPS + 1, count), NUM_PAST_STEPS
    )
    deviation = np.repeat([POSITION_NOISE_M, ROTATION_NOISE_RAD], 3) / STEP_S
    return shortened(
        twists + levels[:, None, None] * deviation * rng.standard_normal(twists.shape), known
    )


def shortened(twists: FloatArray, known: IntArray) -> FloatArray:
    """Only the last `known` [N] steps are known; the earliest of them stands for those before, as
    in a forecast.
    """
    steps = np.maximum(np.arange(twists.shape[1]), (twists.shape[1] - known)[:, None])
    return np.take_along_axis(twists, steps[..., None], axis=1)
