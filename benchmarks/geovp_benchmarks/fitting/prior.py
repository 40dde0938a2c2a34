"""Fit of the motion prior: the central path, then the spread of its errors on held-out roads.

Poses that a car cannot have driven are left out (`plausibility`): KITTI's ground truth jumps, and
the regions would be too wide elsewhere.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import softmax

from geovp_benchmarks.fitting import calibration, network_training
from geovp_benchmarks.fitting.calibration import Calibration
from geovp_benchmarks.fitting.network_training import Schedule
from geovp_benchmarks.fitting.plausibility import Drivability
from geovp_benchmarks.fitting.training_windows import (
    STEP_S,
    Augmentation,
    Grid,
    TrainingWindows,
    with_stationary,
)
from geovp_classic.errors import BadData
from geovp_classic.forecasting.motion_network import (
    CentreModel,
    Coefficients,
    DampedTurn,
    SpreadFeatures,
    SpreadModel,
    Standardisation,
    mixture_parameters,
    past_features,
    with_mirrored,
)
from geovp_classic.types import FloatArray, Trajectory


@dataclass(frozen=True)
class Errors:
    """Errors of central paths on windows that they were not fitted to."""

    twists: FloatArray  # [N, P, 6]
    paths: FloatArray  # [N, F, 3]
    deviations: FloatArray  # [N, F, 3], of the true states, along the paths


@dataclass(frozen=True)
class PriorFit:
    """Settings of the fit, selected by cross-validation on the training sequences and on `val`."""

    grid: Grid = field(default_factory=Grid)
    augmentation: Augmentation = field(default_factory=Augmentation)
    calibration: Calibration = field(default_factory=Calibration)
    piece_steps: int = 1000  # minimum length of a held-out piece of a sequence
    stationary_fraction: float = 0.03  # windows of a stationary car, added to every sequence
    num_members: int = 2
    centre_width: int = 96
    centre_epochs: float = 40.0
    yaw_weight_m: float = 8.0  # metres that a radian of yaw error counts as
    num_modes: int = 6
    depth: int = 12  # smooth deviations of which the modes are made
    spread_members: int = 3
    spread_width: int = 48
    spread_epochs: float = 24.0
    seed: int = 0

    def fit(
        self,
        sequences: Mapping[str, Trajectory],
        others: Mapping[str, Trajectory],
        progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> Coefficients:
        """Fit coefficients to at least two sequences, by cross-validation over their pieces.

        The sequences in `others` are used only to calibrate the size of the regions. `progress`
        receives the number of trained networks and their total.
        """
        if len(sequences) < 2:
            raise BadData(f"{len(sequences)} sequence to fit to, expected two or more")
        names = []
        pieces = []
        for name, sequence in sequences.items():
            parts = self._pieces(name, sequence)
            pieces += parts
            names += [name] * len(parts)
        training = [with_stationary(piece, self.stationary_fraction) for piece in pieces]
        total = 2 * len(pieces) + 2
        done = itertools.count()
        progress(next(done), total)
        centres = []
        errors = []
        for number, held_out in enumerate(training):
            centres.append(self.fit_centre(training[:number] + training[number + 1 :]))
            errors.append(self._errors(centres[-1], held_out))
            progress(next(done), total)
        trials: dict[str, list[tuple[Coefficients, TrainingWindows]]] = {}
        for number, (name, piece) in enumerate(zip(names, pieces, strict=True)):
            spread = self.fit_spread(errors[:number] + errors[number + 1 :])
            trials.setdefault(name, []).append((Coefficients(centres[number], spread), piece))
            progress(next(done), total)
        centre = self.fit_centre(training)
        progress(next(done), total)
        fitted = Coefficients(centre, self.fit_spread(errors))
        progress(next(done), total)
        for name, other in others.items():
            trials[name] = [(fitted, piece) for piece in self._pieces(name, other)]
        return calibration.rescaled(fitted, self.calibration.factors(trials.values()))

    def fit_centre(self, parts: Sequence[TrainingWindows]) -> CentreModel:
        """Fit the central path to the least distance plus weighted yaw error, a spatial median."""
        rng = np.random.default_rng(self.seed)
        windows = TrainingWindows.concatenated(parts)
        windows = TrainingWindows(with_mirrored(windows.twists), with_mirrored(windows.states))
        features = past_features(windows.twists)
        inputs = Standardisation.of(features)
        scale = np.abs(self._corrections(windows)).mean(axis=0) + 1e-3
        schedule = Schedule(self._num_steps(self.centre_epochs, len(windows)))

        def batch() -> tuple[FloatArray, FloatArray]:
            drawn = rng.integers(0, len(windows), self.num_members * schedule.batch_size)
            driven = self.augmentation.rescaled(windows[drawn], rng)
            twists = self.augmentation.corrupted(driven.twists, rng)
            target = self._corrections(TrainingWindows(twists, driven.states)) / scale
            shape = (self.num_members, schedule.batch_size, -1)
            standardised = inputs(past_features(twists))
            return standardised.reshape(shape), target.reshape(shape).astype(np.float32)

        def gradient(
            outputs: FloatArray,
            target: FloatArray,
        ) -> FloatArray:
            return centre_gradient(outputs, target, scale, self.yaw_weight_m)

        sizes = (features.shape[1], self.centre_width, self.centre_width, scale.size)
        start = network_training.initialised(sizes, self.num_members, rng)
        network = network_training.train(start, batch, gradient, schedule, rng)
        return CentreModel(STEP_S, inputs, scale, network)

    def fit_spread(self, errors: Sequence[Errors]) -> SpreadModel:
        """Fit a mixture of Gaussians over the errors' principal components given the past."""
        rng = np.random.default_rng(self.seed)
        twists, paths, deviations = (
            with_mirrored(np.concatenate([getattr(part, name) for part in errors]))
            for name in ("twists", "paths", "deviations")
        )
        features = SpreadFeatures()(twists, paths)
        inputs = Standardisation.of(features, SpreadFeatures.limit)
        basis, residual_variance, amounts = components(deviations, self.depth)
        standardised = inputs(features)
        targets = amounts.astype(np.float32)
        num_steps = self._num_steps(self.spread_epochs, len(features))
        schedule = Schedule(num_steps, learning_rate=1e-3, weight_decay=0.05, dropout=0.2)

        def batch() -> tuple[FloatArray, FloatArray]:
            drawn = rng.integers(0, len(features), (self.spread_members, schedule.batch_size))
            return standardised[drawn], targets[drawn]

        def gradient(
            outputs: FloatArray,
            target: FloatArray,
        ) -> FloatArray:
            return mixture_gradient(outputs, target, self.num_modes)

        num_outputs = self.num_modes * (1 + 2 * self.depth)
        sizes = (features.shape[1], self.spread_width, self.spread_width, num_outputs)
        start = network_training.initialised(sizes, self.spread_members, rng)
        log_deviations = np.repeat(np.linspace(-1.5, 0.5, self.num_modes), self.depth)
        start.biases[-1][..., -len(log_deviations) :] = log_deviations  # from narrow to wide modes
        network = network_training.train(start, batch, gradient, schedule, rng)
        return SpreadModel(inputs, network, basis, residual_variance, self.num_modes)

    def _corrections(self, windows: TrainingWindows) -> FloatArray:
        """Return the states [N, F, 3] relative to the damped turn."""
        return windows.states - DampedTurn()(windows.twists, STEP_S, self.grid.num_future)

    def _num_steps(
        self,
        epochs: float,
        count: int,
    ) -> int:
        return max(1, int(epochs * count / Schedule.batch_size))

    def _pieces(
        self,
        name: str,
        trajectory: Trajectory,
    ) -> list[TrainingWindows]:
        """Return the windows of a sequence's pieces, which have no pose in common."""
        usable = Drivability().steps(trajectory)
        num_pieces = max(1, len(trajectory) // self.piece_steps)
        bounds = np.linspace(0, len(trajectory), num_pieces + 1).astype(int)
        pieces = [
            self.grid.windows(trajectory[first:end], usable=usable[first : end - 1])
            for first, end in itertools.pairwise(bounds)
        ]
        pieces = [piece for piece in pieces if len(piece)]
        if not pieces:
            raise BadData(
                f"sequence {name} has no stretch of 3.1 s that a car can have driven: give other "
                "poses"
            )
        return pieces

    def _errors(
        self,
        centre: CentreModel,
        held_out: TrainingWindows,
    ) -> Errors:
        """Return the errors on clean and on corrupted pasts."""
        rng = np.random.default_rng(self.seed)
        corrupted = self.augmentation.corrupted(held_out.twists, rng)
        twists = np.concatenate([held_out.twists, corrupted])
        paths = centre(twists)
        states = np.concatenate([held_out.states, held_out.states])
        return Errors(twists, paths, along_path(states - paths, paths))


def centre_gradient(
    outputs: FloatArray,  # [M, B, F * 3]
    target: FloatArray,
    scale: FloatArray,  # [F, 3]
    yaw_weight_m: float,
) -> FloatArray:
    """Return the slope of mean(distance + yaw_weight_m * |yaw error|), smoothed at 0."""
    error = (outputs - target).reshape(*outputs.shape[:2], -1, 3) * scale
    distance = np.sqrt((error[..., :2] ** 2).sum(axis=-1, keepdims=True) + 1e-4)
    yaw = np.sqrt(error[..., 2:] ** 2 + 1e-6)
    by_yaw = yaw_weight_m * error[..., 2:] / yaw
    slope = np.concatenate([error[..., :2] / distance, by_yaw], axis=-1)
    slope = slope * scale / (outputs.shape[1] * len(scale))
    return slope.reshape(outputs.shape).astype(np.float32)


def mixture_gradient(
    outputs: FloatArray,  # [M, B, K * (1 + 2 D)]
    target: FloatArray,  # [M, B, D]
    num_modes: int,
) -> FloatArray:
    """Return the slope of the mean negative log likelihood (Bishop 1994, eq. 34-39)."""
    log_weights, means, log_deviations = mixture_parameters(outputs, num_modes)
    inverse = np.exp(-log_deviations)
    white = (target[..., None, :] - means) * inverse
    log_joint = log_weights + (-0.5 * white**2 - log_deviations).sum(axis=-1)
    posterior = softmax(log_joint, axis=-1)
    by_weight = np.exp(log_weights) - posterior
    by_mean = -posterior[..., None] * white * inverse
    by_deviation = posterior[..., None] * (1 - white**2)
    flat = (*outputs.shape[:-1], -1)
    slopes = [by_weight, by_mean.reshape(flat), by_deviation.reshape(flat)]
    return (np.concatenate(slopes, axis=-1) / target.shape[-2]).astype(np.float32)


def components(
    errors: FloatArray,  # [N, F, 3]
    depth: int,  # D
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the principal components of errors [N, F, 3].

    These are the basis [F, 3, D], the residual variances [F, 3] and the amounts [N, D].
    """
    deviation = np.sqrt((errors**2).mean(axis=0)) + 1e-6
    white = (errors / deviation).reshape(len(errors), -1)
    values, vectors = np.linalg.eigh(white.T @ white / len(white))
    vectors = vectors[:, ::-1][:, :depth]
    roots = np.sqrt(values[::-1][:depth])
    amounts = white @ vectors
    residual = (white - amounts @ vectors.T).reshape(errors.shape) * deviation
    basis = (vectors * roots).reshape(*deviation.shape, depth) * deviation[..., None]
    return basis, (residual**2).mean(axis=0) + 1e-10, amounts / roots


def along_path(
    deviations: FloatArray,  # [N, F, 3]
    path: FloatArray,  # [N, F, 3]
) -> FloatArray:
    """Return deviations (x, z, yaw) [N, F, 3] from a path as (right, ahead, yaw) of it."""
    x, z, yaw = np.moveaxis(deviations, -1, 0)
    cos = np.cos(path[..., 2])
    sin = np.sin(path[..., 2])
    return np.stack([cos * x - sin * z, sin * x + cos * z, yaw], axis=-1)


def packed(coefficients: Coefficients) -> dict[str, FloatArray]:
    """Return the arrays of a coefficient file, as `motion_prior.load` reads them."""
    centre = coefficients.centre
    spread = coefficients.spread
    licence = (
        "Fitted to ground-truth poses of KITTI odometry 00, 01, 02, 04, 08, 09 (Geiger et al. "
        "2012), CC BY-NC-SA 3.0."
    )
    table: dict[str, FloatArray] = {
        "step_s": np.array(centre.step_s),
        "num_modes": np.array(spread.num_modes),
        "centre_scale": centre.scale,
        "basis": spread.basis,
        "floor": spread.residual_variance,
        "licence": np.array(licence),
    }
    for name, model in (("centre", centre), ("spread", spread)):
        table[f"{name}_mean"] = model.inputs.mean
        table[f"{name}_deviation"] = model.inputs.deviation
        for layer, weight in enumerate(model.network.weights):
            table[f"{name}_weight{layer}"] = weight
        for layer, bias in enumerate(model.network.biases):
            table[f"{name}_bias{layer}"] = bias
    return table
