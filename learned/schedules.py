"""When a training run sees which example, and how fast it learns by then: functions of the step alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from learned.recipes import Training


def rate_share(step: int, settings: Training) -> float:
    """Share of the full rate: a linear rise, then half a cosine down to `final_rate` (Loshchilov and Hutter 2017)."""
    if step < settings.warmup_steps:
        return (step + 1) / settings.warmup_steps
    done = (step - settings.warmup_steps) / max(settings.num_steps - settings.warmup_steps, 1)
    return settings.final_rate + (1 - settings.final_rate) * 0.5 * (1 + math.cos(math.pi * min(done, 1.0)))


@dataclass(frozen=True)
class Order:
    """Every example once an epoch, in an order of its own each time, dealt out over steps and devices."""

    num_examples: int
    batch_size: int
    num_devices: int
    seed: int

    def at(self, step: int) -> list[list[int]]:
        """The indices of each device's batch at a step; batches go on across the ends of epochs."""
        size = self.batch_size * self.num_devices
        places = np.arange(step * size, (step + 1) * size)
        epochs, within = np.divmod(places, self.num_examples)
        orders = {epoch: self._epoch(epoch) for epoch in np.unique(epochs).tolist()}
        chosen = [int(orders[epoch][place]) for epoch, place in zip(epochs.tolist(), within.tolist(), strict=True)]
        return [chosen[device :: self.num_devices] for device in range(self.num_devices)]

    def _epoch(self, epoch: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        return np.random.default_rng([self.seed, epoch]).permutation(self.num_examples)
