"""Train an ensemble of small perceptrons with AdamW in plain numpy: minutes on one core, without
torch.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from geovp_classic.forecasting.motion_network import Network
from geovp_classic.types import FloatArray

Batch = Callable[
    [], tuple[FloatArray, FloatArray]
]  # features [M, B, in] and targets [M, B, ...] of the next step
Gradient = Callable[
    [FloatArray, FloatArray], FloatArray
]  # d loss / d outputs, from outputs [M, B, out] and targets
Trace = list[
    tuple[FloatArray, FloatArray]
]  # per layer: its input, and d input / d pre-activation of the layer before


@dataclass(frozen=True)
class Schedule:
    """AdamW (Loshchilov and Hutter 2019) with one cycle of the learning rate (Smith 2018)."""

    num_steps: int
    batch_size: int = 256
    learning_rate: float = 2e-3
    weight_decay: float = 1e-2
    dropout: float = 0.1
    warm_up: float = 0.15  # share of the steps

    def rate(self, step: int) -> float:
        """The learning rate of one step, counted from 1."""
        done = step / self.num_steps
        if done < self.warm_up:
            return self.learning_rate * done / self.warm_up
        return (
            self.learning_rate
            * 0.5
            * (1 + np.cos(np.pi * (done - self.warm_up) / (1 - self.warm_up)))
        )


def initialised(sizes: tuple[int, ...], num_members: int, rng: np.random.Generator) -> Network:
    """Random weights (He et al. 2015), small in the last layer; biases 0."""
    weights, biases = [], []
    for layer, (num_in, num_out) in enumerate(itertools.pairwise(sizes)):
        gain = 0.05 if layer == len(sizes) - 2 else 2.0
        weight = rng.standard_normal((num_members, num_in, num_out)) * np.sqrt(gain / num_in)
        weights.append(weight.astype(np.float32))
        biases.append(np.zeros((num_members, 1, num_out), np.float32))
    return Network(tuple(weights), tuple(biases))


def train(
    network: Network, batch: Batch, gradient: Gradient, schedule: Schedule, rng: np.random.Generator
) -> Network:
    """The trained network; the given one stays as it is."""
    parameters = [array.copy() for array in (*network.weights, *network.biases)]
    num_layers = len(network.weights)
    current = Network(tuple(parameters[:num_layers]), tuple(parameters[num_layers:]))
    mean, square = [np.zeros_like(a) for a in parameters], [np.zeros_like(a) for a in parameters]
    for step in range(1, schedule.num_steps + 1):
        features, target = batch()
        outputs, trace = forward(current, features, schedule.dropout, rng)
        slopes = backward(current, trace, gradient(outputs, target))
        rate = np.float32(schedule.rate(step))
        for i, (parameter, slope) in enumerate(zip(parameters, slopes, strict=True)):
            mean[i] += 0.1 * (slope - mean[i])
            square[i] += 0.001 * (slope**2 - square[i])
            move = mean[i] / (1 - 0.9**step) / (np.sqrt(square[i] / (1 - 0.999**step)) + 1e-8)
            decay = schedule.weight_decay if i < num_layers else 0.0
            parameter -= (rate * (move + decay * parameter)).astype(np.float32)
    return current


def forward(
    network: Network, features: FloatArray, dropout: float, rng: np.random.Generator
) -> tuple[FloatArray, Trace]:
    """Outputs [M, B, out] with dropout of hidden units, and what back-propagation needs."""
    hidden, trace = features, [(features, np.ones(1, np.float32))]
    for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
        before = hidden @ weight + bias
        gate = expit(before)
        kept = (rng.random(before.shape, dtype=np.float32) >= dropout).astype(
            np.float32
        ) / np.float32(1 - dropout)
        hidden = before * gate * kept
        trace.append((hidden, gate * (1 + before * (1 - gate)) * kept))
    return hidden @ network.weights[-1] + network.biases[-1], trace


def backward(network: Network, trace: Trace, slope: FloatArray) -> list[FloatArray]:
    """Slopes of the loss by weights, then biases, from d loss / d outputs."""
    weights, biases = [], []
    for weight, (hidden, by_pre_activation) in zip(network.weights[::-1], trace[::-1], strict=True):
        weights.append(np.swapaxes(hidden, 1, 2) @ slope)
        biases.append(slope.sum(1, keepdims=True))
        if len(weights) < len(network.weights):
            slope = (slope @ np.swapaxes(weight, 1, 2)) * by_pre_activation
    return [*weights[::-1], *biases[::-1]]
