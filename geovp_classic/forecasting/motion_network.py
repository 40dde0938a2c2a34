"""The two models of the motion prior: the centre path, and a mixture of smooth deviations from it.

The past is the camera's twists per second (v, w) in its own frame over P steps of an even grid, [N,
P, 6]. Mirroring left and right maps a past and its future to another pair that is as likely.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.special import expit, logsumexp

from geovp_classic.types import FloatArray

FORWARD, YAW_RATE = 2, 4
MIRRORED_TWIST = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
MIRRORED_STATE = np.array([-1.0, 1.0, -1.0])
TURN_DECAY = 0.95  # of the turn rate, per step of the damped turn
RECENT = 3  # steps that the damped turn takes its turn rate and acceleration from
SPREAD_STEPS = (4, 9, 19)  # states of the centre path that the spread depends on
SPREAD_LIMIT = (
    3.0  # deviations: beyond the fastest known drives the spread is theirs, not an extrapolated one
)
LEAST_CHANGE = np.repeat([1e-2, 1e-3], 3)  # m/s and rad/s, added before logarithms


@dataclass(frozen=True)
class Network:
    """An ensemble of M multilayer perceptrons with SiLU activations, as plain arrays."""

    weights: tuple[FloatArray, ...]  # each [M, in, out]
    biases: tuple[FloatArray, ...]  # each [M, 1, out]

    def __call__(self, features: FloatArray) -> FloatArray:
        """Outputs [M, N, out] of standardised features [N, in]."""
        hidden = features
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            before = hidden @ weight + bias
            hidden = before * expit(before)
        return np.asarray(hidden @ self.weights[-1] + self.biases[-1])


@dataclass(frozen=True)
class Standardisation:
    """Features brought to mean 0 and deviation 1, and clipped at `limit` deviations."""

    mean: FloatArray  # [in]
    deviation: FloatArray  # [in]
    limit: float = 8.0

    @classmethod
    def of(cls, features: FloatArray, limit: float = 8.0) -> Self:
        """That of features [N, in]."""
        return cls(features.mean(0), features.std(0) + 1e-6, limit)

    def __call__(self, features: FloatArray) -> FloatArray:
        """The same shape, float32."""
        return np.clip((features - self.mean) / self.deviation, -self.limit, self.limit).astype(
            np.float32
        )


@dataclass(frozen=True)
class CentreModel:
    """The centre path: a damped turn, corrected by a network."""

    step_s: float
    inputs: Standardisation
    scale: FloatArray  # [F, 3], of the corrections
    network: Network

    def __call__(self, twists: FloatArray) -> FloatArray:
        """States [N, F, 3] after twists [N, P, 6]: mean over the ensemble and over both sides of
        the mirror.
        """
        both = with_mirrored(twists)
        outputs = self.network(self.inputs(past_features(both))).mean(0)
        correction = outputs.reshape(len(both), *self.scale.shape) * self.scale
        ours, mirrored = np.split(correction + damped_turn(both, self.step_s, len(self.scale)), 2)
        return np.asarray(0.5 * (ours + mirrored * MIRRORED_STATE))


@dataclass(frozen=True)
class SpreadModel:
    """A mixture of Gaussians over amounts of D smooth deviations from the centre path (Bishop
    1994).
    """

    inputs: Standardisation
    network: Network
    basis: FloatArray  # [F, 3, D], the deviations as (right, ahead, yaw) of the path
    residual_variance: FloatArray  # [F, 3], what the basis leaves out
    num_modes: int

    def __call__(
        self, twists: FloatArray, centre: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weights [2K], means [2K, D] and deviations [2K, D] for one past [1, P, 6] and its centre
        path [1, F, 3].

        The second half is of the mirrored past and goes with the mirrored basis.
        """
        features = spread_features(with_mirrored(twists), with_mirrored(centre))
        outputs = np.swapaxes(self.network(self.inputs(features)), 0, 1).astype(
            np.float64
        )  # [2, M, ...]
        log_weights, means, log_deviations = mixture_parameters(outputs, self.num_modes)
        depth = means.shape[-1]
        weights = np.exp(log_weights).reshape(-1)
        return (
            weights / weights.sum(),
            means.reshape(-1, depth),
            np.exp(log_deviations).reshape(-1, depth),
        )


@dataclass(frozen=True)
class Coefficients:
    """Everything that is fitted."""

    centre: CentreModel
    spread: SpreadModel


def with_mirrored(values: FloatArray) -> FloatArray:
    """Twists [N, P, 6] or states [N, F, 3] and, behind them, the same with left and
    right swapped.
    """
    return np.concatenate(
        [values, values * (MIRRORED_TWIST if values.shape[-1] == 6 else MIRRORED_STATE)]
    )


def past_features(twists: FloatArray) -> FloatArray:
    """The changes from step to step and the last twist [N, P * 6]: small accelerations must not
    drown in the speed.
    """
    return np.concatenate([np.diff(twists, axis=1), twists[:, -1:]], axis=1).reshape(
        len(twists), -1
    )


def spread_features(twists: FloatArray, centre: FloatArray) -> FloatArray:
    """Past, mean speed, states of the centre path [N, F, 3], and logarithms of how much the past
    changes.
    """
    states = centre[:, SPREAD_STEPS].reshape(len(twists), -1)
    past = [past_features(twists), twists[:, :, FORWARD].mean(1, keepdims=True), states]
    return np.concatenate(
        [*past, _log_changes(twists), np.log(np.abs(centre[:, -1, 2:]) + 1e-2)], axis=1
    )


def _log_changes(twists: FloatArray) -> FloatArray:
    """Logarithms [N, 17] of the past's jitter, changes, turning and speed."""
    speed, turn = np.abs(twists[..., FORWARD]), np.abs(twists[..., YAW_RATE])
    change = np.abs(twists[:, -1] - twists[:, -1 - RECENT])
    jitter, changes = (
        np.sqrt((np.diff(twists, order, axis=1) ** 2).mean(1)) + LEAST_CHANGE for order in (2, 1)
    )
    turning = (
        np.stack([turn.mean(1), turn[:, -RECENT:].mean(1), change[:, YAW_RATE]], axis=1) + 1e-3
    )
    driving = np.stack([speed.mean(1) + 0.1, change[:, FORWARD] + 0.03], axis=1)
    return np.log(np.concatenate([jitter, changes, turning, driving], axis=1))


def damped_turn(twists: FloatArray, step_s: float, num_steps: int) -> FloatArray:
    """States [N, F, 3] at constant acceleration, without reversing, and with a turn rate that
    decays.
    """
    speed = twists[:, -1, FORWARD]
    earlier = twists[:, max(len(twists[0]) - 1 - RECENT, 0), FORWARD]
    acceleration = (speed - earlier) / (RECENT * step_s)
    speeds = speed[:, None] + acceleration[:, None] * (np.arange(num_steps + 1) * step_s)
    direction = np.where(speed != 0, np.sign(speed), np.sign(acceleration))[:, None]
    speeds = np.where(speeds * direction < 0, 0.0, speeds)
    turns = (
        twists[:, -RECENT:, YAW_RATE].mean(1)[:, None]
        * TURN_DECAY ** np.arange(1, num_steps + 1)
        * step_s
    )
    yaw = np.cumsum(turns, axis=1)
    path, middle = 0.5 * (speeds[:, 1:] + speeds[:, :-1]) * step_s, yaw - turns / 2
    return np.stack(
        [np.cumsum(path * np.sin(middle), 1), np.cumsum(path * np.cos(middle), 1), yaw], axis=-1
    )


def mixture_parameters(
    outputs: FloatArray, num_modes: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log weights [..., K], means [..., K, D] and log deviations [..., K, D] of the spread
    network's outputs.
    """
    depth = (outputs.shape[-1] // num_modes - 1) // 2
    shape = (*outputs.shape[:-1], num_modes, depth)
    logits, means, log_deviations = np.split(outputs, [num_modes, num_modes * (1 + depth)], axis=-1)
    log_weights = logits - logsumexp(logits, axis=-1, keepdims=True)
    return log_weights, means.reshape(shape), np.clip(log_deviations.reshape(shape), -4.0, 3.0)
