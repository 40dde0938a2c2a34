"""Gaussian latent variables, and the LSTMs that predict them."""

import torch
from torch import Tensor, nn
from torch.distributions import Normal

LstmState = tuple[Tensor, Tensor]  # hidden and cell state, each [layers, B, size]


def normal(output: Tensor) -> Normal:
    """Return the normal distributions of a network's output [..., 2 * D]: D means, then D log
    variances.
    """
    mean, log_variance = output.float().chunk(2, dim=-1)
    return Normal(mean, torch.exp(0.5 * log_variance.clamp(-10, 10)))


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
