"""Gaussians with numbers worked out by hand, and the LSTM that goes on where it stopped."""

import math

import torch

from geovp_learned.video.latents import Lstm, normal


def test_outputs_are_means_and_log_variances_that_are_clamped() -> None:
    drawn = normal(torch.tensor([[5.0, 0.0, math.log(0.25), 99.0]]))
    assert drawn.mean.tolist() == [[5.0, 0.0]]
    torch.testing.assert_close(drawn.stddev, torch.tensor([[0.5, math.exp(5)]]))


def test_steps_one_by_one_are_the_same_as_all_at_once() -> None:
    torch.manual_seed(0)
    lstm = Lstm(3, 5, 2, 4)
    numbers = torch.randn(2, 6, 3)
    whole, _ = lstm(numbers)
    _, memory = lstm(numbers[:, :4])
    fifth, memory = lstm(numbers[:, 4:5], memory)
    sixth, _ = lstm(numbers[:, 5:], memory)
    torch.testing.assert_close(torch.cat([fifth, sixth], dim=1), whole[:, 4:])
