"""What the motion prior computes with: histories as features, a damped turn as the first guess, two small networks.

A history is the camera's twist per second (v, w) in its own frame over the past steps of an even grid, [N, P, 6].
Mirroring left and right maps a history and its future to another one that is as likely.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logsumexp

from geovp_classic.types import FloatArray

FORWARD, YAW_RATE = 2, 4
MIRRORED_RATES = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
MIRRORED_STATES = np.array([-1.0, 1.0, -1.0])
TURN_KEPT = 0.95  # of the turn rate, per step of the first guess
RECENT = 3  # steps that the first guess's turn rate and acceleration come from
SPREAD_STEPS = (4, 9, 19)  # where the first network says the path goes, for the second one
SPREAD_LIMIT = (
    3.0  # deviations: on a motorway the spread of the fastest known drives is better than an extrapolated one
)
LEAST_CHANGE = np.repeat([1e-2, 1e-3], 3)  # m/s and rad/s: smaller is as good as nothing, for logarithms


@dataclass(frozen=True)
class Network:
    """An ensemble of M perceptrons with SiLU in between; plain arrays."""

    weights: tuple[FloatArray, ...]  # each [M, in, out]
    biases: tuple[FloatArray, ...]  # each [M, 1, out]

    def __call__(self, features: FloatArray) -> FloatArray:
        """Outputs [M, N, out] of standardised features [N, in]."""
        hidden = features
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            before = hidden @ weight + bias
            hidden = before * expit(before)
        output: FloatArray = hidden @ self.weights[-1] + self.biases[-1]
        return output


@dataclass(frozen=True)
class Standard:
    """Features brought to mean 0 and deviation 1, and no further out than `limit` deviations."""

    mean: FloatArray  # [in]
    deviation: FloatArray  # [in]
    limit: float = 8.0

    def __call__(self, features: FloatArray) -> FloatArray:
        """The same shape, float32."""
        return np.clip((features - self.mean) / self.deviation, -self.limit, self.limit).astype(np.float32)


@dataclass(frozen=True)
class Coefficients:
    """Everything that is fitted."""

    step_s: float
    centre_standard: Standard
    centre_scale: FloatArray  # [F, 3]
    centre: Network
    spread_standard: Standard
    spread: Network
    basis: FloatArray  # [F, 3, D], off the centre path: (right, ahead, yaw)
    floor: FloatArray  # [F, 3], variances that the basis leaves out
    num_modes: int

    @property
    def num_steps(self) -> int:
        """F, the steps of the future grid."""
        return self.centre_scale.shape[0]


def history_features(rates: FloatArray) -> FloatArray:
    """The changes from step to step and the last twist [N, P * 6]: small accelerations must not drown in the speed."""
    return np.concatenate([np.diff(rates, axis=1), rates[:, -1:]], axis=1).reshape(len(rates), -1)


def spread_features(rates: FloatArray, centre: FloatArray) -> FloatArray:
    """History, mean speed, where the centre path [N, F, 3] goes, and logarithms of how calm the past was."""
    ahead = centre[:, SPREAD_STEPS].reshape(len(rates), -1)
    history = [history_features(rates), rates[:, :, FORWARD].mean(1, keepdims=True), ahead]
    return np.concatenate([*history, _calmness(rates), np.log(np.abs(centre[:, -1, 2:]) + 1e-2)], axis=1)


def _calmness(rates: FloatArray) -> FloatArray:
    """Logarithms [N, 17] of the past's changes, jitter, speed and turning: a spread is a matter of factors."""
    speed, turn = np.abs(rates[..., FORWARD]), np.abs(rates[..., YAW_RATE])
    change = np.abs(rates[:, -1] - rates[:, -1 - RECENT])
    jitter, changes = (np.sqrt((np.diff(rates, order, axis=1) ** 2).mean(1)) + LEAST_CHANGE for order in (2, 1))
    turning = np.stack([turn.mean(1), turn[:, -RECENT:].mean(1), change[:, YAW_RATE]], axis=1) + 1e-3
    driving = np.stack([speed.mean(1) + 0.1, change[:, FORWARD] + 0.03], axis=1)
    return np.log(np.concatenate([jitter, changes, turning, driving], axis=1))


def first_guess(rates: FloatArray, step_s: float, num_steps: int) -> FloatArray:
    """Constant acceleration, no reversing, and a turn rate that decays: states [N, F, 3]."""
    speed = rates[:, -1, FORWARD]
    earlier = rates[:, max(len(rates[0]) - 1 - RECENT, 0), FORWARD]
    acceleration = (speed - earlier) / (RECENT * step_s)
    ends = np.arange(num_steps + 1) * step_s
    speeds = speed[:, None] + acceleration[:, None] * ends
    direction = np.where(speed != 0, np.sign(speed), np.sign(acceleration))[:, None]
    speeds = np.where(speeds * direction < 0, 0.0, speeds)
    turns = rates[:, -RECENT:, YAW_RATE].mean(1)[:, None] * TURN_KEPT ** np.arange(1, num_steps + 1) * step_s
    yaw = np.cumsum(turns, axis=1)
    path, middle = 0.5 * (speeds[:, 1:] + speeds[:, :-1]) * step_s, yaw - turns / 2
    return np.stack([np.cumsum(path * np.sin(middle), 1), np.cumsum(path * np.cos(middle), 1), yaw], axis=-1)


def centres(coefficients: Coefficients, rates: FloatArray) -> FloatArray:
    """The centre path [N, F, 3]: mean over the ensemble and over both sides of the mirror."""
    ways = np.concatenate([rates, rates * MIRRORED_RATES])
    outputs = coefficients.centre(coefficients.centre_standard(history_features(ways))).mean(0)
    residual = outputs.reshape(len(ways), coefficients.num_steps, 3) * coefficients.centre_scale
    paths = residual + first_guess(ways, coefficients.step_s, coefficients.num_steps)
    count = len(rates)
    mean: FloatArray = 0.5 * (paths[:count] + paths[count:] * MIRRORED_STATES)
    return mean


def split_modes(outputs: FloatArray, num_modes: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log weights [..., K], means [..., K, D] and log deviations [..., K, D] of the second network's outputs."""
    depth = (outputs.shape[-1] // num_modes - 1) // 2
    shape = (*outputs.shape[:-1], num_modes, depth)
    cut = num_modes * (1 + depth)
    logits = outputs[..., :num_modes]
    log_weights = logits - logsumexp(logits, axis=-1, keepdims=True)
    means = outputs[..., num_modes:cut].reshape(shape)
    return log_weights, means, np.clip(outputs[..., cut:].reshape(shape), -4.0, 3.0)


def modes(
    coefficients: Coefficients, rates: FloatArray, centre: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights [2K], means [2K, D] and deviations [2K, D] around one centre path [1, F, 3].

    The second half comes from the mirrored history and goes with the mirrored basis.
    """
    ways = np.concatenate([rates, rates * MIRRORED_RATES])
    paths = np.concatenate([centre, centre * MIRRORED_STATES])
    outputs = coefficients.spread(coefficients.spread_standard(spread_features(ways, paths)))
    by_way = np.swapaxes(outputs, 0, 1).astype(np.float64)  # [2, M, ...]
    log_weights, means, log_deviations = split_modes(by_way, coefficients.num_modes)
    depth = means.shape[-1]
    weights = np.exp(log_weights).reshape(-1) / (2 * len(outputs))
    return weights, means.reshape(-1, depth), np.exp(log_deviations).reshape(-1, depth)
