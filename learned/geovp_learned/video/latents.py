"""Gaussian latent variables, their KL divergence, and the LSTMs that predict them."""

from typing import NamedTuple, Self

import torch
from torch import Tensor, nn

LstmState = tuple[Tensor, Tensor]  # hidden and cell state, each [layers, B, size]


class Gaussian(
    NamedTuple
):  # a tuple, so that Lightning Fabric finds the tensors in a network's output
    """Independent normal distributions."""

    mean: Tensor
    log_variance: Tensor

    @classmethod
    def from_output(cls, output: Tensor) -> Self:
        """Split a network's output [..., 2 * D]: D means, then D log variances."""
        mean, log_variance = output.chunk(2, dim=-1)
        return cls(mean, log_variance.clamp(-10, 10))

    def sample(self, noise: Tensor | None = None) -> Tensor:
        """Draw a sample by standard normal noise, by default torch's (reparameterisation, Kingma
        and Welling 2014).
        """
        noise = torch.randn_like(self.mean) if noise is None else noise
        return self.mean + torch.exp(0.5 * self.log_variance) * noise


def kl_divergence(a: Gaussian, b: Gaussian) -> Tensor:
    """Return KL(a || b) in nats, summed over the last axis."""
    variances = torch.exp(a.log_variance - b.log_variance)
    distances = (a.mean - b.mean) ** 2 * torch.exp(-b.log_variance)
    return 0.5 * (b.log_variance - a.log_variance + variances + distances - 1).sum(-1)


class Lstm(nn.Module):
    """An LSTM between two linear layers."""

    def __init__(self, in_size: int, hidden_size: int, layers: int, out_size: int) -> None:
        super().__init__()
        self.inward = nn.Linear(in_size, hidden_size)
        self.lstm = nn.LSTM(hidden_size, hidden_size, layers, batch_first=True)
        self.outward = nn.Linear(hidden_size, out_size)

    def forward(self, inputs: Tensor, state: LstmState | None = None) -> tuple[Tensor, LstmState]:
        """Return outputs [B, T, out_size] of inputs [B, T, in_size], and the state after the last
        step.
        """
        hidden, state = self.lstm(self.inward(inputs), state)
        return self.outward(hidden), state

    def step(self, inputs: Tensor, state: LstmState) -> tuple[Tensor, LstmState]:
        """Run one time step: [B, in_size] to [B, out_size]."""
        outputs, state = self(inputs[:, None], state)
        return outputs[:, 0], state


def expand_state(state: LstmState, rows: int) -> LstmState:
    """Expand the state of one clip to that of a batch of `rows` equal ones."""
    hidden, cell = (part.expand(-1, rows, -1).contiguous() for part in state)
    return hidden, cell
