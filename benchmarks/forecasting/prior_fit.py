"""Fit the motion prior: the centre path first, then the spread to the errors it makes on pieces of road left out.

What no car could have driven is left out of all of it (`plausibility`): KITTI's ground truth jumps, and a region as
wide as its jumps would be too wide wherever it doesn't.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from benchmarks.forecasting import calibration, histories, network_training, plausibility
from benchmarks.forecasting.histories import NUM_FUTURE_STEPS, STEP_S, Examples
from benchmarks.forecasting.network_training import Schedule
from benchmarks.forecasting.watching import Watch, unwatched
from geovp_classic.errors import BadData
from geovp_classic.forecasting import motion_network
from geovp_classic.forecasting.motion_network import MIRRORED_RATES, MIRRORED_STATES, Coefficients, Network, Standard
from geovp_classic.types import FloatArray, Trajectory


@dataclass(frozen=True)
class Plan:
    """How the prior is fitted; chosen by leaving out one train sequence after the other, and on the val sequences."""

    stride: int = 2
    piece_steps: int = 1000  # at least, of a sequence: so much is left out at once
    standing_share: float = 0.03  # examples of standing cars, added to every sequence
    num_members: int = 2
    centre_width: int = 96
    centre_epochs: float = 40.0
    yaw_weight_m: float = 8.0  # metres that a radian of yaw error is worth
    num_modes: int = 6
    depth: int = 12  # smooth deviations that the modes are made of
    spread_members: int = 3
    spread_width: int = 48
    spread_epochs: float = 24.0
    seed: int = 0


@dataclass(frozen=True)
class Centre:
    """The first network with what belongs to it."""

    standard: Standard
    scale: FloatArray  # [F, 3]
    network: Network


@dataclass(frozen=True)
class Errors:
    """What centres did on histories that they were not fitted to."""

    rates: FloatArray  # [N, P, 6]
    paths: FloatArray  # [N, F, 3], the centres
    off: FloatArray  # [N, F, 3], of the true states along these paths

    @staticmethod
    def joined(parts: Iterable[Errors]) -> Errors:
        """All of them, one behind the other."""
        columns = zip(*((part.rates, part.paths, part.off) for part in parts), strict=True)
        return Errors(*(np.concatenate(column) for column in columns))


def fit(
    sequences: Mapping[str, Trajectory],
    plan: Plan,
    others: Mapping[str, Trajectory] | None = None,
    watch: Watch = unwatched,
) -> Coefficients:
    """Coefficients from at least two sequences, of which one piece after the other is left out.

    What happens on a piece left out shows the errors to expect and what a region holds. The regions' size is set on
    these and on `others`, which nothing else is fitted to; every sequence has the same say.
    """
    if len(sequences) < 2:
        raise BadData(f"{len(sequences)} sequence to fit to, expected two or more: there must be more than one driver")
    data = {name: _pieces(name, trajectory, plan) for name, trajectory in sequences.items()}
    unseen = {name: histories.joined(_pieces(name, trajectory, plan)) for name, trajectory in (others or {}).items()}
    pieces = [(name, number) for name in data for number in range(len(data[name]))]
    driven = {(name, number): data[name][number] for name, number in pieces}
    with_standing = {piece: _with_standing(examples, plan) for piece, examples in driven.items()}
    rng, jobs = np.random.default_rng(plan.seed), _Jobs(2 * len(pieces) + 2, watch)
    centres, errors = {}, {}
    for left_out in pieces:
        centres[left_out] = fit_centre(histories.joined(with_standing[p] for p in pieces if p != left_out), plan)
        errors[left_out] = left_out_errors(centres[left_out], with_standing[left_out], rng)
        jobs.finish_one()
    trials: dict[str, list[tuple[Coefficients, Examples]]] = {name: [] for name in data}
    for left_out in pieces:
        seen = Errors.joined(errors[p] for p in pieces if p != left_out)
        trials[left_out[0]].append((fit_spread(centres[left_out], seen, plan), driven[left_out]))
        jobs.finish_one()
    centre = fit_centre(histories.joined(with_standing.values()), plan)
    jobs.finish_one()
    fitted = fit_spread(centre, Errors.joined(errors.values()), plan)
    jobs.finish_one()
    trials |= {name: [(fitted, examples)] for name, examples in unseen.items()}
    return calibration.resized(fitted, calibration.scales(trials.values()))


class _Jobs:
    """How many of the networks are trained."""

    def __init__(self, total: int, watch: Watch) -> None:
        self._done, self._total, self._watch = 0, total, watch
        watch(0, total)

    def finish_one(self) -> None:
        self._done += 1
        self._watch(self._done, self._total)


def left_out_errors(centre: Centre, unseen: Examples, rng: np.random.Generator) -> Errors:
    """The centre's errors on clean and on faulty histories."""
    rates = np.concatenate([unseen.rates, histories.faulty(unseen.rates, rng)])
    paths = motion_network.centres(_coefficients(centre), rates)
    return Errors(rates, paths, along_path(np.concatenate([unseen.states] * 2) - paths, paths))


def _pieces(name: str, trajectory: Trajectory, plan: Plan) -> list[Examples]:
    """Examples of a sequence's pieces; none of a piece shares a pose with one of another."""
    usable = plausibility.drivable(trajectory)
    bounds = np.linspace(0, len(trajectory), max(1, len(trajectory) // plan.piece_steps) + 1).astype(int)
    pieces = [
        histories.examples(trajectory[first:end], plan.stride, usable[first : end - 1])
        for first, end in itertools.pairwise(bounds)
    ]
    pieces = [examples for examples in pieces if len(examples)]
    if not pieces:
        raise BadData(f"sequence {name} has no stretch of 3.1 s that a car could have driven: give other poses")
    return pieces


def _with_standing(driven: Examples, plan: Plan) -> Examples:
    return histories.joined([driven, histories.standing(int(np.ceil(plan.standing_share * len(driven))))])


def fit_centre(data: Examples, plan: Plan) -> Centre:
    """The centre path: least mean distance plus weighted absolute yaw error, a median in space."""
    rng = np.random.default_rng(plan.seed)
    data = data.mirrored()
    clean = motion_network.history_features(data.rates)
    standard = Standard(clean.mean(0), clean.std(0) + 1e-6)
    guess = motion_network.first_guess(data.rates, STEP_S, NUM_FUTURE_STEPS)
    scale = np.abs(data.states - guess).mean(0) + 1e-3
    schedule = Schedule(num_steps=max(1, int(plan.centre_epochs * len(data) / 256)))

    def batch() -> tuple[FloatArray, FloatArray]:
        chosen = rng.integers(0, len(data), plan.num_members * schedule.batch_size)
        driven = histories.resized(data.chosen(chosen), rng)
        rates = histories.faulty(driven.rates, rng)
        wanted = (driven.states - motion_network.first_guess(rates, STEP_S, NUM_FUTURE_STEPS)) / scale
        shape = (plan.num_members, schedule.batch_size, -1)
        features = standard(motion_network.history_features(rates))
        return features.reshape(shape), wanted.reshape(shape).astype(np.float32)

    def gradient(outputs: FloatArray, wanted: FloatArray) -> FloatArray:
        return centre_gradient(outputs, wanted, scale, plan.yaw_weight_m)

    sizes = (clean.shape[1], plan.centre_width, plan.centre_width, NUM_FUTURE_STEPS * 3)
    start = network_training.fresh(sizes, plan.num_members, rng)
    return Centre(standard, scale, network_training.train(start, batch, gradient, schedule, rng))


def centre_gradient(outputs: FloatArray, wanted: FloatArray, scale: FloatArray, yaw_weight_m: float) -> FloatArray:
    """Slope of mean(distance + yaw_weight_m * |yaw error|) by the outputs [M, B, F * 3], corners rounded off."""
    off = (outputs - wanted).reshape(*outputs.shape[:2], -1, 3) * scale
    distance = np.sqrt((off[..., :2] ** 2).sum(-1, keepdims=True) + 1e-4)
    yaw = np.sqrt(off[..., 2:] ** 2 + 1e-6)
    slope = np.concatenate([off[..., :2] / distance, yaw_weight_m * off[..., 2:] / yaw], axis=-1)
    return (slope * scale / (outputs.shape[1] * len(scale))).reshape(outputs.shape).astype(np.float32)


def fit_spread(centre: Centre, seen: Errors, plan: Plan) -> Coefficients:
    """A mixture of Gaussians over the errors' principal components [D], given the history (Bishop 1994)."""
    rng = np.random.default_rng(plan.seed)
    rates = np.concatenate([seen.rates, seen.rates * MIRRORED_RATES])
    paths = np.concatenate([seen.paths, seen.paths * MIRRORED_STATES])
    features = motion_network.spread_features(rates, paths)
    basis, floor, amounts = components(np.concatenate([seen.off, seen.off * MIRRORED_STATES]), plan.depth)
    standard = Standard(features.mean(0), features.std(0) + 1e-6, motion_network.SPREAD_LIMIT)
    inputs, wanted = standard(features), amounts.astype(np.float32)
    schedule = Schedule(
        num_steps=max(1, int(plan.spread_epochs * len(inputs) / 256)),
        learning_rate=1e-3,
        weight_decay=0.05,
        dropout=0.2,
    )

    def batch() -> tuple[FloatArray, FloatArray]:
        chosen = rng.integers(0, len(inputs), (plan.spread_members, schedule.batch_size))
        return inputs[chosen], wanted[chosen]

    def gradient(outputs: FloatArray, target: FloatArray) -> FloatArray:
        return mixture_gradient(outputs, target, plan.num_modes)

    sizes = (inputs.shape[1], plan.spread_width, plan.spread_width, plan.num_modes * (1 + 2 * plan.depth))
    start = network_training.fresh(sizes, plan.spread_members, rng)
    apart = np.repeat(np.linspace(-1.5, 0.5, plan.num_modes), plan.depth)  # modes begin narrow to wide
    start.biases[-1][:, 0, -len(apart) :] = apart
    spread = network_training.train(start, batch, gradient, schedule, rng)
    return _coefficients(centre, standard, spread, basis, floor, plan.num_modes)


def mixture_gradient(outputs: FloatArray, wanted: FloatArray, num_modes: int) -> FloatArray:
    """Slope of the mean negative log likelihood of amounts [..., D] by the outputs (Bishop 1994, eq. 34-39)."""
    log_weights, means, log_deviations = motion_network.split_modes(outputs, num_modes)
    white = (wanted[..., None, :] - means) * np.exp(-log_deviations)
    log_share = log_weights + (-0.5 * white**2 - log_deviations).sum(-1)
    share = np.exp(log_share - logsumexp(log_share, axis=-1, keepdims=True))
    flat = (*outputs.shape[:-1], -1)
    by_mean = (-share[..., None] * white * np.exp(-log_deviations)).reshape(flat)
    by_deviation = (share[..., None] * (1 - white**2)).reshape(flat)
    slope = np.concatenate([np.exp(log_weights) - share, by_mean, by_deviation], axis=-1)
    return (slope / wanted.shape[-2]).astype(np.float32)


def components(errors: FloatArray, depth: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Basis [F, 3, D] of errors [N, F, 3], variances [F, 3] that it leaves out, and amounts [N, D] of variance 1."""
    deviation = np.sqrt((errors**2).mean(0)) + 1e-6
    white = (errors / deviation).reshape(len(errors), -1)
    values, vectors = np.linalg.eigh(white.T @ white / len(white))
    vectors, roots = vectors[:, ::-1][:, :depth], np.sqrt(values[::-1][:depth])
    amounts = white @ vectors
    floor = ((white - amounts @ vectors.T) ** 2).mean(0).reshape(deviation.shape) * deviation**2 + 1e-10
    basis = (vectors * roots).reshape(*deviation.shape, depth) * deviation[..., None]
    return basis, floor, amounts / roots


def along_path(off: FloatArray, path: FloatArray) -> FloatArray:
    """Deviations (x, z, yaw) [N, F, 3] from a path as (right, ahead, yaw) of it."""
    cos, sin = np.cos(path[..., 2]), np.sin(path[..., 2])
    right, ahead = cos * off[..., 0] - sin * off[..., 1], sin * off[..., 0] + cos * off[..., 1]
    return np.stack([right, ahead, off[..., 2]], axis=-1)


def _coefficients(
    centre: Centre,
    standard: Standard | None = None,
    spread: Network | None = None,
    basis: FloatArray | None = None,
    floor: FloatArray | None = None,
    num_modes: int = 1,
) -> Coefficients:
    """Coefficients, without a spread while only the centre is known."""
    return Coefficients(
        step_s=STEP_S,
        centre_standard=centre.standard,
        centre_scale=centre.scale,
        centre=centre.network,
        spread_standard=standard or centre.standard,
        spread=spread or centre.network,
        basis=np.zeros((*centre.scale.shape, 1)) if basis is None else basis,
        floor=np.zeros(centre.scale.shape) if floor is None else floor,
        num_modes=num_modes,
    )
