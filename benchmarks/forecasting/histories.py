"""What the motion prior learns from: twist histories with the path that followed, and faults added to them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.motion_network import MIRRORED_RATES, MIRRORED_STATES
from geovp_classic.forecasting.motion_prior import NUM_PAST_STEPS
from geovp_classic.geometry import planar, se3
from geovp_classic.types import BoolArray, FloatArray, IntArray, Trajectory

STEP_S = 0.1037  # KITTI's frame interval
NUM_FUTURE_STEPS = 21  # a little more than 20 frames of jittering times
RESIZED = (-0.2, 0.8)  # logarithm of the factor: from 0.8 to 2.2, so that town drives become motorway ones
POSITION_NOISE_M, ROTATION_NOISE_RAD = 0.02, np.radians(0.05)  # per step: noise level 1


@dataclass(frozen=True)
class Examples:
    """N histories with their futures."""

    rates: FloatArray  # [N, P, 6]
    states: FloatArray  # [N, F, 3]

    def __len__(self) -> int:
        """N."""
        return len(self.rates)

    def chosen(self, which: IntArray) -> Examples:
        """Some of them, by number."""
        return Examples(self.rates[which], self.states[which])

    def mirrored(self) -> Examples:
        """These and, behind them, the same with left and right swapped."""
        rates = np.concatenate([self.rates, self.rates * MIRRORED_RATES])
        return Examples(rates, np.concatenate([self.states, self.states * MIRRORED_STATES]))


def resized(data: Examples, rng: np.random.Generator, share: float = 0.4) -> Examples:
    """A share of the examples driven faster or slower along a longer or shorter path of the same turns.

    Recorded speeds end at 15 m/s; without this a motorway is an extrapolation, and so is a monocular scale error.
    """
    factors = np.where(rng.random(len(data)) < share, np.exp(rng.uniform(*RESIZED, len(data))), 1.0)
    lengths = factors[:, None, None]
    rates = np.concatenate([data.rates[..., :3] * lengths, data.rates[..., 3:]], axis=-1)
    return Examples(rates, np.concatenate([data.states[..., :2] * lengths, data.states[..., 2:]], axis=-1))


def joined(parts: Iterable[Examples]) -> Examples:
    """All of them, one behind the other."""
    parts = list(parts)
    return Examples(np.concatenate([p.rates for p in parts]), np.concatenate([p.states for p in parts]))


def examples(trajectory: Trajectory, stride: int, usable: BoolArray | None = None) -> Examples:
    """One example every `stride` frames of a sequence, where all its steps [N - 1] are usable."""
    rates: list[FloatArray] = [np.empty((0, NUM_PAST_STEPS, 6))]
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
        rates.append(past_motion.body_rates(past, STEP_S, NUM_PAST_STEPS)[None])
        poses = _poses_at(trajectory, times_s)
        states.append(planar.reduce(poses, past.world_from_cam[-1], past_motion.vehicle_from_cam(past))[None])
    return Examples(np.concatenate(rates), np.concatenate(states))


def standing(count: int) -> Examples:
    """Cars that stand and go on standing: recorded sequences are cut where the car waits, the world is not."""
    return Examples(np.zeros((count, NUM_PAST_STEPS, 6)), np.zeros((count, NUM_FUTURE_STEPS, 3)))


def faulty(rates: FloatArray, rng: np.random.Generator, max_noise: float = 2.0, cut_share: float = 0.25) -> FloatArray:
    """Histories [N, P, 6] as odometry gives them: half with noise of some level, a share of them short."""
    count = len(rates)
    levels = np.where(rng.random(count) < 0.5, 0.0, np.exp(rng.uniform(np.log(0.05), np.log(max_noise), count)))
    known = np.where(rng.random(count) < cut_share, rng.integers(1, NUM_PAST_STEPS + 1, count), NUM_PAST_STEPS)
    return shortened(noisy(rates, levels, rng), known)


def noisy(rates: FloatArray, levels: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Every step of a history measured with independent errors, of 2 cm and 0.05 degrees at level 1."""
    deviation = np.repeat([POSITION_NOISE_M, ROTATION_NOISE_RAD], 3) / STEP_S
    return rates + levels[:, None, None] * deviation * rng.standard_normal(rates.shape)


def shortened(rates: FloatArray, known: FloatArray) -> FloatArray:
    """Only the last `known` [N] steps are known; the earliest of them stands for those before, as in a forecast."""
    first = (rates.shape[1] - np.asarray(known, dtype=int))[:, None]
    steps = np.maximum(np.arange(rates.shape[1]), first)
    return np.take_along_axis(rates, steps[..., None], axis=1)


def _poses_at(trajectory: Trajectory, times_s: FloatArray) -> FloatArray:
    after = np.clip(np.searchsorted(trajectory.times_s, times_s, side="right"), 1, len(trajectory) - 1)
    before_s, after_s = trajectory.times_s[after - 1], trajectory.times_s[after]
    share = (times_s - before_s) / (after_s - before_s)
    return se3.interpolate(trajectory.world_from_cam[after - 1], trajectory.world_from_cam[after], share)
