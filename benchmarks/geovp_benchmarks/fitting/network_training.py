"""Training of an ensemble of small perceptrons with AdamW, in minutes on one core."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from geovp_classic.forecasting.motion_network import Network
from geovp_classic.types import FloatArray

# Features [M, B, in] and targets [M, B, ...] of the next step.
Batch = Callable[[], tuple[FloatArray, FloatArray]]
# Slope of the loss by the outputs [M, B, out], given outputs and targets.
Gradient = Callable[[FloatArray, FloatArray], FloatArray]
# Of each layer: its input, and the derivative of this input by the linear part before it.
Trace = list[tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Schedule:
    """AdamW (Loshchilov and Hutter 2019) with one cycle of the learning rate (Smith 2018)."""

    num_steps: int
    batch_size: int = 256
    learning_rate: float = 2e-3
    weight_decay: float = 1e-2
    dropout: float = 0.1
    warm_up_fraction: float = 0.15  # of the steps

    def rate(self, step: int) -> float:
        """Return the learning rate of a step, counted from 1."""
        progress = step / self.num_steps
        if progress < self.warm_up_fraction:
            return self.learning_rate * progress / self.warm_up_fraction
        remaining = (1 - progress) / (1 - self.warm_up_fraction)
        return self.learning_rate * 0.5 * (1 - np.cos(np.pi * remaining))


def initialised(
    sizes: tuple[int, ...],
    num_members: int,
    rng: np.random.Generator,
) -> Network:
    """Draw random weights (He et al. 2015), small in the last layer; biases are 0."""
    weights = []
    biases = []
    for layer, (num_in, num_out) in enumerate(itertools.pairwise(sizes)):
        gain = 0.05 if layer == len(sizes) - 2 else 2.0
        weight = rng.standard_normal((num_members, num_in, num_out)) * np.sqrt(gain / num_in)
        weights.append(weight.astype(np.float32))
        biases.append(np.zeros((num_members, 1, num_out), np.float32))
    return Network(tuple(weights), tuple(biases))


def train(
    start: Network,
    batch: Batch,
    gradient: Gradient,
    schedule: Schedule,
    rng: np.random.Generator,
) -> Network:
    """Return the trained network."""
    parameters = [array.copy() for array in (*start.weights, *start.biases)]
    num_layers = len(start.weights)
    network = Network(tuple(parameters[:num_layers]), tuple(parameters[num_layers:]))
    means = [np.zeros_like(array) for array in parameters]
    squares = [np.zeros_like(array) for array in parameters]
    for step in range(1, schedule.num_steps + 1):
        features, target = batch()
        outputs, trace = forward(network, features, schedule.dropout, rng)
        slopes = backward(network, trace, gradient(outputs, target))
        rate = np.float32(schedule.rate(step))
        for i, (parameter, slope) in enumerate(zip(parameters, slopes, strict=True)):
            means[i] += 0.1 * (slope - means[i])
            squares[i] += 0.001 * (slope**2 - squares[i])
            mean = means[i] / (1 - 0.9**step)
            square = squares[i] / (1 - 0.999**step)
            decay = schedule.weight_decay if i < num_layers else 0.0
            change = mean / (np.sqrt(square) + 1e-8) + decay * parameter
            parameter -= (rate * change).astype(np.float32)
    return network


def forward(
    network: Network,
    features: FloatArray,  # [M, B, in]
    dropout: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, Trace]:
    """Return outputs [M, B, out] with dropout of hidden units, and the trace."""
    hidden = features
    trace = [(features, np.ones(1, np.float32))]
    for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
        linear = hidden @ weight + bias
        gate = expit(linear)
        is_on = rng.random(linear.shape, dtype=np.float32) >= dropout
        mask = is_on.astype(np.float32) / np.float32(1 - dropout)
        hidden = linear * gate * mask
        trace.append((hidden, gate * (1 + linear * (1 - gate)) * mask))
    return hidden @ network.weights[-1] + network.biases[-1], trace


def backward(
    network: Network,
    trace: Trace,
    slope: FloatArray,  # [M, B, out]
) -> list[FloatArray]:
    """Return slopes of the loss by weights, then biases, from its slope by the outputs."""
    weights = []
    biases = []
    for weight, (hidden, derivative) in zip(network.weights[::-1], trace[::-1], strict=True):
        weights.append(np.swapaxes(hidden, 1, 2) @ slope)
        biases.append(slope.sum(axis=1, keepdims=True))
        if len(weights) < len(network.weights):
            slope = (slope @ np.swapaxes(weight, 1, 2)) * derivative
    return [*weights[::-1], *biases[::-1]]
