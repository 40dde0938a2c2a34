"""Recurrent networks of SVG and SLAMP, with the module names of the authors' repositories.

LSTM cells work on vectors, or on feature maps with convolutions of 3x3 (ConvLSTM, Shi et al. 2015).
"""

from collections.abc import Iterable
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn
from torch.distributions import Normal, kl_divergence


class ConvLstmCell(nn.Module):
    """An LSTM cell on maps [B, C, H, W]; its gates are input, forget, output and cell."""

    def __init__(self, in_channels: int, hidden_channels: int) -> None:
        super().__init__()
        self.hidden_channels = hidden_channels
        self.conv = nn.Conv2d(in_channels + hidden_channels, 4 * hidden_channels, 3, padding=1)

    def forward(self, inputs: Tensor, state: tuple[Tensor, Tensor] | None) -> tuple[Tensor, Tensor]:
        """Return hidden and cell state after the inputs; without a state, from zero."""
        if state is None:
            zeros = inputs.new_zeros(len(inputs), self.hidden_channels, *inputs.shape[2:])
            state = zeros, zeros
        hidden, cell = state
        gates = self.conv(torch.cat([inputs, hidden], dim=1)).chunk(4, dim=1)
        opening, keeping, showing = (torch.sigmoid(gate) for gate in gates[:3])
        cell = keeping * cell + opening * torch.tanh(gates[3])
        return showing * torch.tanh(cell), cell


class Recurrent(nn.Module):
    """LSTM cells after an embedding; `Memory` steps them."""

    def __init__(
        self, in_size: int, hidden_size: int, layers: int, *, is_grid: bool, is_embedded: bool
    ) -> None:
        super().__init__()
        self.layer: Any = partial(nn.Conv2d, kernel_size=3, padding=1) if is_grid else nn.Linear
        cell = ConvLstmCell if is_grid else nn.LSTMCell
        first = hidden_size if is_embedded else in_size
        self.embed = self.layer(in_size, hidden_size) if is_embedded else nn.Identity()
        sizes = [first, *[hidden_size] * (layers - 1)]
        self.lstm = nn.ModuleList(cell(size, hidden_size) for size in sizes)


class LstmPredictor(Recurrent):
    """A recurrent network that predicts codes in (-1, 1)."""

    def __init__(
        self, in_size: int, out_size: int, hidden_size: int, layers: int, *, is_grid: bool = False
    ) -> None:
        super().__init__(in_size, hidden_size, layers, is_grid=is_grid, is_embedded=True)
        self.output = nn.Sequential(self.layer(hidden_size, out_size), nn.Tanh())

    def forward(self, hidden: Tensor) -> Tensor:
        """Read a code from the last hidden state."""
        return self.output(hidden)


class GaussianLstm(Recurrent):
    """A recurrent network that predicts normal distributions; on grids without an embedding."""

    def __init__(
        self, in_size: int, out_size: int, hidden_size: int, layers: int, *, is_grid: bool = False
    ) -> None:
        super().__init__(in_size, hidden_size, layers, is_grid=is_grid, is_embedded=not is_grid)
        self.mu_net = self.layer(hidden_size, out_size)
        self.logvar_net = self.layer(hidden_size, out_size)

    def forward(self, hidden: Tensor) -> Normal:
        """Read a distribution from the last hidden state."""
        return Normal(self.mu_net(hidden), torch.exp(0.5 * self.logvar_net(hidden)))


class Memory:
    """The states of all recurrent networks of one rollout, which start at zero."""

    def __init__(self) -> None:
        self._states: dict[Recurrent, list[Any]] = {}

    def __call__(self, network: Any, inputs: Tensor) -> Any:
        """Step a recurrent network by one input, and return what it predicts."""
        states = self._states.setdefault(network, [None] * len(network.lstm))
        now = network.embed(inputs)
        for index, cell in enumerate(network.lstm):
            states[index] = cell(now, states[index])
            now = states[index][0]
        return network(now)


def drawn(distribution: Normal, noise: Tensor) -> Tensor:
    """Return the sample that standard normal numbers stand for."""
    return distribution.mean + distribution.stddev * noise


def summed_nats(pairs: Iterable[tuple[Normal, Normal]]) -> Tensor:
    """Return the KL divergence of posteriors from priors, summed over pairs, per clip."""
    return torch.stack([kl_divergence(*pair).flatten(1).sum(1).mean() for pair in pairs]).sum()
