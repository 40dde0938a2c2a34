"""A running mean of the weights, less noisy than where the last step happened to end (Polyak and Juditsky 1992)."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import torch
from torch import nn


class RunningMean:
    """Means of all floating-point numbers of some networks over about their last `num_steps` steps; 0 keeps none."""

    def __init__(self, networks: Mapping[str, nn.Module], num_steps: int) -> None:
        """Begin with the networks as they are."""
        self._networks, self._num_steps = networks, num_steps
        self._means = {name: copy.deepcopy(net) for name, net in networks.items()} if num_steps else {}

    @property
    def stored(self) -> dict[str, nn.Module]:
        """What a training's state has to hold of it, as networks."""
        return {f"{name}-mean": mean for name, mean in self._means.items()}

    @torch.no_grad()
    def update(self, step: int) -> None:
        """After step number `step`, counted from 1: of the first steps the plain mean, then one that forgets."""
        for name, mean in self._means.items():
            for held, now in zip(mean.state_dict().values(), self._networks[name].state_dict().values(), strict=True):
                if held.is_floating_point():
                    held.lerp_(now, 1 / min(step, self._num_steps))
                else:
                    held.copy_(now)

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """The networks are their means for a while, and then themselves again."""
        self._swap()
        try:
            yield
        finally:
            self._swap()

    @torch.no_grad()
    def _swap(self) -> None:
        for name, mean in self._means.items():
            for held, now in zip(mean.state_dict().values(), self._networks[name].state_dict().values(), strict=True):
                kept = now.clone()
                now.copy_(held)
                held.copy_(kept)
