"""Models of the motion prior: a central path, and a mixture of smooth deviations from it.

The past is twists per second [N, P, 6] of the camera over P steps of an even grid. A past and its
future are as likely as their mirror images.
"""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from scipy.special import expit, logsumexp

from geovp_classic.forecasting.past_motion import Axis
from geovp_classic.types import FloatArray

MIRRORED_TWIST = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
MIRRORED_STATE = np.array([-1.0, 1.0, -1.0])


@dataclass(frozen=True)
class Network:
    """Ensemble of M multilayer perceptrons with SiLU activations."""

    weights: tuple[FloatArray, ...]  # each [M, in, out]
    biases: tuple[FloatArray, ...]  # each [M, 1, out]

    def __call__(self, features: FloatArray) -> FloatArray:
        """Return outputs [M, N, out] of standardised features [N, in]."""
        hidden = features
        for weight, bias in zip(
            self.weights[:-1], self.biases[:-1], strict=True
        ):
            linear = hidden @ weight + bias
            hidden = linear * expit(linear)
        return hidden @ self.weights[-1] + self.biases[-1]


@dataclass(frozen=True)
class Standardisation:
    """Features of mean 0 and deviation 1, clipped at `limit` deviations."""

    mean: FloatArray  # [in]
    deviation: FloatArray  # [in]
    limit: float = 8.0

    @classmethod
    def of(
        cls,
        features: FloatArray,  # [N, in]
        limit: float = 8.0,
    ) -> Self:
        """Return the standardisation of features [N, in]."""
        return cls(features.mean(0), features.std(0) + 1e-6, limit)

    def __call__(self, features: FloatArray) -> FloatArray:
        """Return standardised features [N, in], float32."""
        standardised = (features - self.mean) / self.deviation
        return np.clip(standardised, -self.limit, self.limit).astype(np.float32)


@dataclass(frozen=True)
class DampedTurn:
    """Motion at constant acceleration, without reversing, and with a decaying turn rate."""

    turn_decay: float = 0.95  # of the turn rate, per step
    num_recent: int = 3  # steps that give the turn rate and the acceleration

    def __call__(
        self,
        twists: FloatArray,  # [N, P, 6], per second
        step_s: float,
        num_steps: int,
    ) -> FloatArray:
        """Return states [N, F, 3] after twists [N, P, 6]."""
        past = twists[..., Axis.FORWARD]
        last = past[:, -1:]
        earlier = past[:, -1 - self.num_recent, None]
        change = (last - earlier) / self.num_recent  # per step
        speeds = last + change * np.arange(num_steps + 1)
        speeds = np.where(
            speeds * last < 0, 0.0, speeds
        )  # braking ends at rest
        turn_rate = twists[:, -self.num_recent :, Axis.YAW].mean(axis=1)
        decay = self.turn_decay ** np.arange(1, num_steps + 1)
        turns = turn_rate[:, None] * decay * step_s
        yaw = np.cumsum(turns, axis=1)
        chord_yaw = yaw - turns / 2
        chord = 0.5 * (speeds[:, 1:] + speeds[:, :-1]) * step_s
        x = np.cumsum(chord * np.sin(chord_yaw), axis=1)
        z = np.cumsum(chord * np.cos(chord_yaw), axis=1)
        return np.stack([x, z, yaw], axis=-1)


@dataclass(frozen=True)
class CentreModel:
    """The central path: a damped turn, corrected by a network."""

    step_s: float
    inputs: Standardisation
    scale: FloatArray  # [F, 3], of the corrections
    network: Network
    baseline: DampedTurn = field(default_factory=DampedTurn)

    def __call__(
        self,
        twists: FloatArray,  # [N, P, 6], per second
    ) -> FloatArray:
        """Return states [N, F, 3], averaged over the ensemble and the mirror image."""
        both = with_mirrored(twists)
        outputs = self.network(self.inputs(past_features(both))).mean(0)
        corrections = outputs.reshape(len(both), *self.scale.shape) * self.scale
        paths = self.baseline(both, self.step_s, len(self.scale)) + corrections
        ahead, mirrored = np.split(paths, 2)
        return 0.5 * (ahead + mirrored * MIRRORED_STATE)


@dataclass(frozen=True)
class SpreadFeatures:
    """Inputs of the spread: the past, the central path, and logarithms of how much both change."""

    path_steps: tuple[int, ...] = (4, 9, 19)
    num_recent: int = 3
    limit: float = 3.0  # deviations; faster driving than in training has the spread of the fastest

    def __call__(
        self,
        twists: FloatArray,  # [N, P, 6], per second
        centre: FloatArray,  # [N, F, 3]
    ) -> FloatArray:
        """Return features [N, in] of twists [N, P, 6] and central paths [N, F, 3]."""
        columns = [
            past_features(twists),
            twists[..., Axis.FORWARD].mean(axis=1),
            centre[:, self.path_steps].reshape(len(twists), -1),
            self._log_changes(twists),
            np.log(np.abs(centre[:, -1, 2]) + 1e-2),
        ]
        return np.column_stack(columns)

    def _log_changes(
        self,
        twists: FloatArray,  # [N, P, 6], per second
    ) -> FloatArray:
        """Return logarithms [N, 17] of jitter, changes, turn rates, speed and acceleration."""
        noise_floor = np.repeat([1e-2, 1e-3], 3)  # m/s, rad/s
        jitter = np.sqrt((np.diff(twists, 2, axis=1) ** 2).mean(axis=1))
        changes = np.sqrt((np.diff(twists, axis=1) ** 2).mean(axis=1))
        recent_change = np.abs(twists[:, -1] - twists[:, -1 - self.num_recent])
        turn_rate = np.abs(twists[..., Axis.YAW])
        speed = np.abs(twists[..., Axis.FORWARD])
        columns = [
            jitter + noise_floor,
            changes + noise_floor,
            turn_rate.mean(axis=1) + 1e-3,
            turn_rate[:, -self.num_recent :].mean(axis=1) + 1e-3,
            recent_change[:, Axis.YAW] + 1e-3,
            speed.mean(axis=1) + 0.1,
            recent_change[:, Axis.FORWARD] + 0.03,
        ]
        return np.log(np.column_stack(columns))


@dataclass(frozen=True)
class SpreadModel:
    """Mixture of K Gaussians over amounts of D smooth deviations (Bishop 1994)."""

    inputs: Standardisation
    network: Network
    basis: FloatArray  # [F, 3, D], the deviations as (right, ahead, yaw) of the path
    residual_variance: FloatArray  # [F, 3], outside the basis
    num_modes: int
    features: SpreadFeatures = field(default_factory=SpreadFeatures)

    def __call__(
        self,
        twists: FloatArray,  # [1, P, 6]
        centre: FloatArray,  # [1, F, 3]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return weights [2K], means [2K, D] and deviations [2K, D].

        The second half is of the mirrored past and belongs to the mirrored basis.
        """
        features = self.features(with_mirrored(twists), with_mirrored(centre))
        outputs = self.network(self.inputs(features)).astype(np.float64)
        by_side = np.swapaxes(outputs, 0, 1)  # [2, M, ...]
        log_weights, means, log_deviations = mixture_parameters(
            by_side, self.num_modes
        )
        weights = np.exp(log_weights).reshape(-1)
        depth = means.shape[-1]
        deviations = np.exp(log_deviations)
        return (
            weights / weights.sum(),
            means.reshape(-1, depth),
            deviations.reshape(-1, depth),
        )


@dataclass(frozen=True)
class Coefficients:
    """Fitted models of the motion prior."""

    centre: CentreModel
    spread: SpreadModel


def with_mirrored(values: FloatArray) -> FloatArray:
    """Return twists [N, P, 6] or states [N, F, 3], followed by their mirror images [2N, ...]."""
    sign = MIRRORED_TWIST if values.shape[-1] == 6 else MIRRORED_STATE
    return np.concatenate([values, values * sign])


def past_features(
    twists: FloatArray,  # [N, P, 6], per second
) -> FloatArray:
    """Return the changes from step to step and the last twist [N, P * 6]."""
    steps = np.concatenate([np.diff(twists, axis=1), twists[:, -1:]], axis=1)
    return steps.reshape(len(twists), -1)


def mixture_parameters(
    outputs: FloatArray,  # [..., K * (1 + 2 D)]
    num_modes: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return log weights [..., K], means [..., K, D] and log deviations [..., K, D]."""
    depth = (outputs.shape[-1] // num_modes - 1) // 2
    shape = (*outputs.shape[:-1], num_modes, depth)
    logits, means, log_deviations = np.split(
        outputs, [num_modes, num_modes * (1 + depth)], axis=-1
    )
    log_weights = logits - logsumexp(logits, axis=-1, keepdims=True)
    log_deviations = np.clip(log_deviations, -4.0, 3.0)
    return log_weights, means.reshape(shape), log_deviations.reshape(shape)
