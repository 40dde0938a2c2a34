"""Fit of the body's motion: a robust ridge regression on recorded poses and their mirror images,
and its residuals.

Their Student's t is sized so that its 50 % and 90 % intervals hold that share of what could have
been driven, every sequence with the same say.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import stats

from geovp_benchmarks.fitting.plausibility import drivable
from geovp_benchmarks.fitting.training_windows import POSITION_NOISE_M, ROTATION_NOISE_RAD, STEP_S
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.body_motion import (
    NUM_PAST_STEPS,
    Coefficients,
    features,
    liveliness,
    over_plane,
)
from geovp_classic.forecasting.motion_network import MIRRORED_TWIST
from geovp_classic.types import BoolArray, FloatArray, Trajectory

NUM_FUTURE_STEPS = 20
STRIDE = 2
NOISE_LEVEL = 0.5  # of an odometry, added to the past twists
RIDGE = 3e-3  # per window
NUM_ROUNDS = 8
UNBOUNDED = 1e3  # no twist reaches it
NEAREST_SHARE = 0.3  # of the median residual; smaller ones don't weigh more
MIRRORED_BODY = np.array([1.0, 1.0, -1.0])  # heave, pitch, roll
SMALLEST = 1e-5  # m, rad: of a residual whose logarithm is taken
DEGREES = np.geomspace(1.5, 60, 400)  # of freedom to choose from
INNER, OUTER = 0.5, 0.9  # probabilities of the two intervals


def fit(
    sequences: Mapping[str, Trajectory], others: Mapping[str, Trajectory], seed: int = 0
) -> Coefficients:
    """The coefficients by iteratively reweighted least squares towards the least absolute error,
    output by output.

    Sequences not used for these, `others`, count for the size of the intervals alone.
    """
    twists, states = (
        np.concatenate(parts) for parts in zip(*map(_windows, sequences.values()), strict=True)
    )
    deviation = NOISE_LEVEL / STEP_S * np.repeat([POSITION_NOISE_M, ROTATION_NOISE_RAD], 3)
    twists = twists + deviation * np.random.default_rng(seed).standard_normal(twists.shape)
    twists = np.concatenate([twists, twists * MIRRORED_TWIST])
    states = np.concatenate([states, states * MIRRORED_BODY]).reshape(len(twists), -1)
    scale = np.full(twists[0].size, 1.0)
    scale = np.sqrt((features(twists / UNBOUNDED, scale) ** 2).mean(axis=0)) * UNBOUNDED + 1e-6
    inputs = features(twists, scale)
    weights = np.stack([_least_absolute(inputs, target) for target in states.T], axis=1)
    fitted = Coefficients(STEP_S, scale, weights, np.zeros((5, weights.shape[1])), np.ones(3))
    return _sized(fitted, list(sequences.values()), list(others.values()))


def packed(coefficients: Coefficients) -> dict[str, FloatArray]:
    """The arrays of a file, as `body_motion.load` reads them."""
    single = {
        name: getattr(coefficients, name).astype(np.float32)
        for name in ("scale", "weights", "spread", "degrees")
    }
    return {"step_s": np.array(coefficients.step_s), **single}


def _sized(
    fitted: Coefficients, sequences: list[Trajectory], others: list[Trajectory]
) -> Coefficients:
    known = [_windows(one, drivable(one)) for one in [*sequences, *others]]
    residuals = [
        np.abs(states - fitted(twists)).reshape(len(twists), -1) for twists, states in known
    ]
    lively = [liveliness(twists) for twists, _ in known]
    inputs, logs = np.concatenate(lively), np.log(np.concatenate(residuals) + SMALLEST)
    spread = np.linalg.solve(
        inputs.T @ inputs + RIDGE * len(inputs) * np.eye(inputs.shape[1]), inputs.T @ logs
    )
    white = [
        one / np.exp(at @ spread) for one, at in zip(residuals, lively, strict=True) if len(one)
    ]
    inner, outer = (
        np.mean([np.quantile(one, share, axis=0) for one in white], axis=0)
        for share in (INNER, OUTER)
    )
    heavy = np.log(outer / inner).reshape(-1, 3).mean(axis=0)
    tails = np.log(stats.t.ppf(0.5 + OUTER / 2, DEGREES) / stats.t.ppf(0.5 + INNER / 2, DEGREES))
    degrees = DEGREES[np.abs(tails[:, None] - heavy).argmin(axis=0)]
    spread[0] += np.log(outer / np.tile(stats.t.ppf(0.5 + OUTER / 2, degrees), len(outer) // 3))
    return replace(fitted, spread=spread, degrees=degrees)


def _windows(
    trajectory: Trajectory, usable: BoolArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Past twists [N, P, 6] and what the body did [N, F, 3], where all steps [N - 1] are usable."""
    ahead_s = STEP_S * np.arange(1, NUM_FUTURE_STEPS + 1)
    last_start_s = trajectory.times_s[-1] - ahead_s[-1]
    twists: list[FloatArray] = [np.empty((0, NUM_PAST_STEPS, 6))]
    states: list[FloatArray] = [np.empty((0, NUM_FUTURE_STEPS, 3))]
    for last in range(
        NUM_PAST_STEPS, int(np.searchsorted(trajectory.times_s, last_start_s)), STRIDE
    ):
        if usable is not None and not usable[last - NUM_PAST_STEPS : last + NUM_FUTURE_STEPS].all():
            continue
        past = trajectory[last - NUM_PAST_STEPS : last + 1]
        twists.append(past_motion.twists_per_s(past, STEP_S, NUM_PAST_STEPS)[None])
        future = past_motion.poses_at(trajectory, past.times_s[-1] + ahead_s)
        states.append(over_plane(future, past)[None])
    return np.concatenate(twists), np.concatenate(states)


def _least_absolute(inputs: FloatArray, target: FloatArray) -> FloatArray:
    """Weights [in]."""
    drawn = RIDGE * np.eye(inputs.shape[1])
    weight = np.ones(len(target))
    for _ in range(NUM_ROUNDS):
        weighted = inputs * weight[:, None]
        found = np.linalg.solve(weighted.T @ inputs + weight.sum() * drawn, weighted.T @ target)
        residual = np.abs(target - inputs @ found)
        weight = 1 / np.maximum(residual, NEAREST_SHARE * np.median(residual) + 1e-12)
        weight /= weight.mean()
    return np.asarray(found)
