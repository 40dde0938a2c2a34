"""Learning rate, seeds, order of examples and mean of the weights: each depends on the step, never
on the time.
"""

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from geovp_learned.training_config import Training

BUILD_SEED, STEP_SEED = 1, 2  # keep the seeds of torch's random numbers apart


def seed(*numbers: int) -> None:
    """Seed torch's random numbers on every device from several numbers."""
    mixed = 0
    for number in numbers:
        mixed = (mixed * 1_000_003 + number + 1) % (2**63 - 1)
    torch.manual_seed(mixed)


def learning_rate_factor(step: int, settings: Training) -> float:
    """Return the factor of a linear warm-up, then of cosine annealing to `final_rate` (Loshchilov
    and Hutter 2017).
    """
    if step < settings.warmup_steps:
        return (step + 1) / settings.warmup_steps
    done = (step - settings.warmup_steps) / max(settings.num_steps - settings.warmup_steps, 1)
    return settings.final_rate + (1 - settings.final_rate) * 0.5 * (
        1 + math.cos(math.pi * min(done, 1.0))
    )


def batch_indices(
    step: int, num_examples: int, batch_size: int, num_devices: int, seed: int
) -> list[list[int]]:
    """Return the examples of each device's batch; each epoch has another permutation, and batches
    may span two epochs.
    """
    size = batch_size * num_devices
    epochs, positions = np.divmod(np.arange(step * size, (step + 1) * size), num_examples)
    orders = {
        epoch: np.random.default_rng([seed, epoch]).permutation(num_examples)
        for epoch in set(epochs.tolist())
    }
    chosen = [
        int(orders[epoch][k]) for epoch, k in zip(epochs.tolist(), positions.tolist(), strict=True)
    ]
    return [chosen[device::num_devices] for device in range(num_devices)]


def averaged_model(network: nn.Module, num_steps: int) -> AveragedModel:
    """Return the EMA (Polyak and Juditsky 1992) of weights and buffers with decay 1 - 1 /
    num_steps; at first their plain mean.
    """

    def average(means: Sequence[Tensor], values: Sequence[Tensor], count: Tensor | int) -> None:
        share = 1 / min(int(count) + 1, num_steps)
        for mean, value in zip(means, values, strict=True):
            if mean.is_floating_point():
                mean.lerp_(value, share)
            else:
                mean.copy_(value)

    return AveragedModel(network, multi_avg_fn=average, use_buffers=True)
