"""Fit the motion prior: the centre path first, then the spread to its errors on held-out pieces of
road.

Poses that no car could have driven are left out (`plausibility`): KITTI's ground truth jumps, and
regions fitted to its jumps would be too wide wherever it doesn't.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from geovp_benchmarks.fitting import calibration, network_training, plausibility, training_windows
from geovp_benchmarks.fitting.network_training import Schedule
from geovp_benchmarks.fitting.training_windows import NUM_FUTURE_STEPS, STEP_S, TrainingWindows
from geovp_classic.errors import BadData
from geovp_classic.forecasting import motion_network
from geovp_classic.forecasting.motion_network import (
    Coefficients,
    SpreadModel,
    Standardisation,
    with_mirrored,
)
from geovp_classic.types import FloatArray, Trajectory

LICENCE = (
    "Fitted to ground-truth poses of KITTI odometry 00, 01, 02, 04, 08, 09 (Geiger et al. "
    "2012), CC BY-NC-SA 3.0."
)


@dataclass(frozen=True)
class Plan:
    """Settings of the fit; chosen by leaving out one train sequence after the other, and on the val
    sequences.
    """

    stride: int = 2
    piece_steps: int = 1000  # the least length of a held-out piece of a sequence
    standing_share: float = 0.03  # windows of standing cars, added to every sequence
    num_members: int = 2
    centre_width: int = 96
    centre_epochs: float = 40.0
    yaw_weight_m: float = 8.0  # metres that a radian of yaw error counts as
    num_modes: int = 6
    depth: int = 12  # smooth deviations that the modes are made of
    spread_members: int = 3
    spread_width: int = 48
    spread_epochs: float = 24.0
    seed: int = 0


# On pasts that a centre path was not fitted to: twists [N, P, 6], centre paths [N, F, 3], and
# deviations [N, F, 3] of
# the true states along these paths.
Errors = tuple[FloatArray, FloatArray, FloatArray]


def fit(
    sequences: Mapping[str, Trajectory],
    plan: Plan,
    others: Mapping[str, Trajectory] | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Coefficients:
    """Coefficients from at least two sequences, by cross-validation over their pieces.

    Errors on held-out pieces show what errors to expect and what a region covers. The regions' size
    is set on these and on `others`, which nothing else is fitted to; every sequence has the same
    weight. `progress` is called with the number of networks trained and their total.
    """
    if len(sequences) < 2:
        raise BadData(
            f"{len(sequences)} sequence to fit to, expected two or more: there must be more "
            "than one driver"
        )
    pieces = [
        (name, piece)
        for name, sequence in sequences.items()
        for piece in _pieces(name, sequence, plan)
    ]
    unseen = {
        name: TrainingWindows.concatenated(_pieces(name, other, plan))
        for name, other in (others or {}).items()
    }
    with_standing = [
        training_windows.with_standing(piece, plan.standing_share) for _, piece in pieces
    ]
    rng, total, done = np.random.default_rng(plan.seed), 2 * len(pieces) + 2, itertools.count(1)
    progress(0, total)
    centres, errors = [], []
    for held_out, piece in enumerate(with_standing):
        centres.append(fit_centre(with_standing[:held_out] + with_standing[held_out + 1 :], plan))
        errors.append(held_out_errors(centres[-1], piece, rng))
        progress(next(done), total)
    trials: dict[str, list[tuple[Coefficients, TrainingWindows]]] = {name: [] for name in sequences}
    for held_out, (name, piece) in enumerate(pieces):
        spread = fit_spread(errors[:held_out] + errors[held_out + 1 :], plan)
        trials[name].append((Coefficients(centres[held_out], spread), piece))
        progress(next(done), total)
    centre = fit_centre(with_standing, plan)
    progress(next(done), total)
    fitted = Coefficients(centre, fit_spread(errors, plan))
    progress(next(done), total)
    trials |= {name: [(fitted, windows)] for name, windows in unseen.items()}
    return calibration.rescaled(fitted, calibration.factors(trials.values()))


def held_out_errors(
    centre: motion_network.CentreModel, unseen: TrainingWindows, rng: np.random.Generator
) -> Errors:
    """The centre path's errors on clean and on corrupted pasts."""
    twists = np.concatenate([unseen.twists, training_windows.corrupted(unseen.twists, rng)])
    paths = centre(twists)
    return twists, paths, along_path(np.concatenate([unseen.states] * 2) - paths, paths)


def _pieces(name: str, trajectory: Trajectory, plan: Plan) -> list[TrainingWindows]:
    """Windows of a sequence's pieces, which share no pose."""
    usable = plausibility.drivable(trajectory)
    bounds = np.linspace(
        0, len(trajectory), max(1, len(trajectory) // plan.piece_steps) + 1
    ).astype(int)
    pieces = [
        training_windows.windows(trajectory[first:end], plan.stride, usable[first : end - 1])
        for first, end in itertools.pairwise(bounds)
    ]
    pieces = [windows for windows in pieces if len(windows)]
    if not pieces:
        raise BadData(
            f"sequence {name} has no stretch of 3.1 s that a car could have driven: give other "
            "poses"
        )
    return pieces


def fit_centre(parts: Sequence[TrainingWindows], plan: Plan) -> motion_network.CentreModel:
    """The centre path: least mean distance plus weighted absolute yaw error, a median in space."""
    rng = np.random.default_rng(plan.seed)
    data = TrainingWindows.concatenated(parts)
    data = TrainingWindows(with_mirrored(data.twists), with_mirrored(data.states))
    clean = motion_network.past_features(data.twists)
    inputs = Standardisation.of(clean)
    scale = (
        np.abs(
            data.states - motion_network.damped_turn(data.twists, STEP_S, NUM_FUTURE_STEPS)
        ).mean(0)
        + 1e-3
    )
    schedule = Schedule(num_steps=max(1, int(plan.centre_epochs * len(data) / 256)))

    def batch() -> tuple[FloatArray, FloatArray]:
        chosen = rng.integers(0, len(data), plan.num_members * schedule.batch_size)
        driven = training_windows.rescaled(data[chosen], rng)
        twists = training_windows.corrupted(driven.twists, rng)
        target = (
            driven.states - motion_network.damped_turn(twists, STEP_S, NUM_FUTURE_STEPS)
        ) / scale
        shape = (plan.num_members, schedule.batch_size, -1)
        features = inputs(motion_network.past_features(twists))
        return features.reshape(shape), target.reshape(shape).astype(np.float32)

    def gradient(outputs: FloatArray, target: FloatArray) -> FloatArray:
        return centre_gradient(outputs, target, scale, plan.yaw_weight_m)

    sizes = (clean.shape[1], plan.centre_width, plan.centre_width, NUM_FUTURE_STEPS * 3)
    start = network_training.initialised(sizes, plan.num_members, rng)
    return motion_network.CentreModel(
        STEP_S, inputs, scale, network_training.train(start, batch, gradient, schedule, rng)
    )


def centre_gradient(
    outputs: FloatArray, target: FloatArray, scale: FloatArray, yaw_weight_m: float
) -> FloatArray:
    """Slope of mean(distance + yaw_weight_m * |yaw error|) by the outputs [M, B, F * 3], smoothed
    at 0.
    """
    error = (outputs - target).reshape(*outputs.shape[:2], -1, 3) * scale
    distance = np.sqrt((error[..., :2] ** 2).sum(-1, keepdims=True) + 1e-4)
    yaw = np.sqrt(error[..., 2:] ** 2 + 1e-6)
    slope = np.concatenate(
        [error[..., :2] / distance, yaw_weight_m * error[..., 2:] / yaw], axis=-1
    )
    return (
        (slope * scale / (outputs.shape[1] * len(scale))).reshape(outputs.shape).astype(np.float32)
    )


def fit_spread(errors: Sequence[Errors], plan: Plan) -> SpreadModel:
    """A mixture of Gaussians over the errors' principal components [D], given the past (Bishop
    1994).
    """
    rng = np.random.default_rng(plan.seed)
    twists, paths, deviations = (np.concatenate(column) for column in zip(*errors, strict=True))
    features = motion_network.spread_features(with_mirrored(twists), with_mirrored(paths))
    basis, residual_variance, amounts = components(with_mirrored(deviations), plan.depth)
    inputs = Standardisation.of(features, motion_network.SPREAD_LIMIT)
    standardised, targets = inputs(features), amounts.astype(np.float32)
    num_steps = max(1, int(plan.spread_epochs * len(features) / 256))
    schedule = Schedule(num_steps, learning_rate=1e-3, weight_decay=0.05, dropout=0.2)

    def batch() -> tuple[FloatArray, FloatArray]:
        chosen = rng.integers(0, len(features), (plan.spread_members, schedule.batch_size))
        return standardised[chosen], targets[chosen]

    def gradient(outputs: FloatArray, target: FloatArray) -> FloatArray:
        return mixture_gradient(outputs, target, plan.num_modes)

    sizes = (
        features.shape[1],
        plan.spread_width,
        plan.spread_width,
        plan.num_modes * (1 + 2 * plan.depth),
    )
    start = network_training.initialised(sizes, plan.spread_members, rng)
    log_deviations = np.repeat(
        np.linspace(-1.5, 0.5, plan.num_modes), plan.depth
    )  # modes begin narrow to wide
    start.biases[-1][:, 0, -len(log_deviations) :] = log_deviations
    network = network_training.train(start, batch, gradient, schedule, rng)
    return SpreadModel(inputs, network, basis, residual_variance, plan.num_modes)


def mixture_gradient(outputs: FloatArray, target: FloatArray, num_modes: int) -> FloatArray:
    """Slope of the mean negative log likelihood of amounts [..., D] by the outputs (Bishop 1994,
    eq. 34-39).
    """
    log_weights, means, log_deviations = motion_network.mixture_parameters(outputs, num_modes)
    white = (target[..., None, :] - means) * np.exp(-log_deviations)
    log_share = log_weights + (-0.5 * white**2 - log_deviations).sum(-1)
    share = np.exp(log_share - logsumexp(log_share, axis=-1, keepdims=True))
    flat = (*outputs.shape[:-1], -1)
    by_mean = (-share[..., None] * white * np.exp(-log_deviations)).reshape(flat)
    by_deviation = (share[..., None] * (1 - white**2)).reshape(flat)
    slope = np.concatenate([np.exp(log_weights) - share, by_mean, by_deviation], axis=-1)
    return (slope / target.shape[-2]).astype(np.float32)


def components(errors: FloatArray, depth: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Principal components of errors [N, F, 3]: basis [F, 3, D], residual variances [F, 3], amounts
    [N, D].
    """
    deviation = np.sqrt((errors**2).mean(0)) + 1e-6
    white = (errors / deviation).reshape(len(errors), -1)
    values, vectors = np.linalg.eigh(white.T @ white / len(white))
    vectors, roots = vectors[:, ::-1][:, :depth], np.sqrt(values[::-1][:depth])
    amounts = white @ vectors
    variance = ((white - amounts @ vectors.T) ** 2).mean(0).reshape(
        deviation.shape
    ) * deviation**2 + 1e-10
    basis = (vectors * roots).reshape(*deviation.shape, depth) * deviation[..., None]
    return basis, variance, amounts / roots


def along_path(deviations: FloatArray, path: FloatArray) -> FloatArray:
    """Deviations (x, z, yaw) [N, F, 3] from a path as (right, ahead, yaw) of it."""
    cos, sin, (x, z, yaw) = (
        np.cos(path[..., 2]),
        np.sin(path[..., 2]),
        np.moveaxis(deviations, -1, 0),
    )
    return np.stack([cos * x - sin * z, sin * x + cos * z, yaw], axis=-1)


def packed(coefficients: Coefficients) -> dict[str, FloatArray]:
    """The arrays of a coefficient file, which `motion_prior.load` reads."""
    centre, spread = coefficients.centre, coefficients.spread
    table: dict[str, FloatArray] = {
        "step_s": np.array(centre.step_s),
        "num_modes": np.array(spread.num_modes),
        "centre_scale": centre.scale,
        "basis": spread.basis,
        "floor": spread.residual_variance,
        "licence": np.array(LICENCE),
    }
    for name, model in (("centre", centre), ("spread", spread)):
        table |= {f"{name}_mean": model.inputs.mean, f"{name}_deviation": model.inputs.deviation}
        table |= {
            f"{name}_weight{layer}": weight for layer, weight in enumerate(model.network.weights)
        }
        table |= {f"{name}_bias{layer}": bias for layer, bias in enumerate(model.network.biases)}
    return table
