"""Gaussian latents: drawing from them, how far two of them are apart, and LSTMs that say which they are."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

Memory = tuple[Tensor, Tensor]  # an LSTM's hidden and cell state, each [layers, B, size]


class Gaussian(NamedTuple):  # a tuple, so that Lightning Fabric can look into what a network gives
    """Independent normal distributions."""

    mean: Tensor
    log_variance: Tensor

    @classmethod
    def standard(cls, like: Tensor) -> Gaussian:
        """Mean 0 and variance 1, in the shape of another tensor."""
        return cls(torch.zeros_like(like), torch.zeros_like(like))

    @classmethod
    def halves(cls, numbers: Tensor) -> Gaussian:
        """Means and log variances side by side in the last axis, as a network gives them."""
        mean, log_variance = numbers.chunk(2, dim=-1)
        return cls(mean, log_variance.clamp(-10, 10))

    def at(self, noise: Tensor) -> Tensor:
        """The draw that standard normal noise makes; gradients reach mean and variance (Kingma and Welling 2014)."""
        return self.mean + torch.exp(0.5 * self.log_variance) * noise

    def draw(self) -> Tensor:
        """A draw with noise from torch's random numbers."""
        return self.at(torch.randn_like(self.mean))


def divergence(a: Gaussian, b: Gaussian) -> Tensor:
    """KL(a || b) in nats, summed over the last axis."""
    variances = torch.exp(a.log_variance - b.log_variance)
    distances = (a.mean - b.mean) ** 2 * torch.exp(-b.log_variance)
    nats: Tensor = 0.5 * (b.log_variance - a.log_variance + variances + distances - 1).sum(-1)
    return nats


class RecurrentMap(nn.Module):
    """Linear, LSTM, linear: numbers from all numbers so far."""

    def __init__(self, in_size: int, hidden_size: int, layers: int, out_size: int) -> None:
        """With so many layers of LSTM."""
        super().__init__()
        self.inward = nn.Linear(in_size, hidden_size)
        self.lstm = nn.LSTM(hidden_size, hidden_size, layers, batch_first=True)
        self.outward = nn.Linear(hidden_size, out_size)

    def forward(self, numbers: Tensor, memory: Memory | None = None) -> tuple[Tensor, Memory]:
        """[B, T, in_size] to [B, T, out_size], going on from a memory; with the memory after the last step."""
        hidden, after = self.lstm(self.inward(numbers), memory)
        return self.outward(hidden), after

    def step(self, numbers: Tensor, memory: Memory) -> tuple[Tensor, Memory]:
        """One step on: [B, in_size] to [B, out_size]."""
        out, after = self(numbers[:, None], memory)
        return out[:, 0], after


def many(memory: Memory, rows: int) -> Memory:
    """The memory of one clip so many times over."""
    hidden, cell = (part.expand(-1, rows, -1).contiguous() for part in memory)
    return hidden, cell
