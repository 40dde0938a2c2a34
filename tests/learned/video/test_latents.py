"""Gaussians with numbers worked out by hand, and the LSTM that goes on where it stopped."""

import math

import pytest
import torch

from geovp_learned.video.latents import Gaussian, Lstm, kl_divergence


def test_divergences_worked_out() -> None:
    standard = Gaussian(torch.zeros(1), torch.zeros(1))
    shifted = Gaussian(torch.tensor([3.0]), torch.zeros(1))
    assert float(kl_divergence(shifted, standard)) == 4.5  # 3^2 / 2
    wide = Gaussian(torch.zeros(1), torch.tensor([math.log(4.0)]))  # a standard deviation of 2
    # KL(N(0, 4) || N(0, 1)) = (4 - 1 - ln 4) / 2; KL(N(3, 1) || N(0, 4)) = (ln 4 + 1 / 4 + 9 / 4 -
    # 1) / 2
    torch.testing.assert_close(float(kl_divergence(wide, standard)), 0.5 * (3 - math.log(4)))
    torch.testing.assert_close(float(kl_divergence(shifted, wide)), 0.5 * (math.log(4) + 1.5))


def test_draws_are_of_the_mean_and_deviation_asked_for_and_teach_both() -> None:
    mean = torch.tensor([5.0], requires_grad=True)
    log_variance = torch.tensor([math.log(0.25)], requires_grad=True)
    drawn = Gaussian(mean, log_variance).sample(torch.tensor([2.0]))
    assert float(drawn.detach()) == pytest.approx(5 + 0.5 * 2)
    drawn.sum().backward()
    assert mean.grad.tolist() == [1.0]
    # d/dv of exp(v / 2) * 2 is exp(v / 2)
    assert log_variance.grad.tolist() == pytest.approx([0.5])


def test_steps_one_by_one_are_the_same_as_all_at_once() -> None:
    torch.manual_seed(0)
    lstm = Lstm(3, 5, 2, 4)
    numbers = torch.randn(2, 6, 3)
    whole, _ = lstm(numbers)
    _, memory = lstm(numbers[:, :4])
    fifth, memory = lstm.step(numbers[:, 4], memory)
    sixth, _ = lstm.step(numbers[:, 5], memory)
    torch.testing.assert_close(torch.stack([fifth, sixth], dim=1), whole[:, 4:])
