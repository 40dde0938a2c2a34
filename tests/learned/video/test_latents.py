"""Gaussians with numbers worked out by hand, and the LSTM that goes on where it stopped."""

import math

import torch

from geovp_learned.video.latents import Gaussian, Lstm, kl_divergence


def test_equal_gaussians_are_zero_apart() -> None:
    random = torch.Generator().manual_seed(0)
    one = Gaussian(torch.randn(5, 4, generator=random), torch.randn(5, 4, generator=random))
    torch.testing.assert_close(kl_divergence(one, one), torch.zeros(5))


def test_divergences_worked_out() -> None:
    standard = Gaussian(torch.zeros(1), torch.zeros(1))
    shifted = Gaussian(torch.tensor([3.0]), torch.zeros(1))
    assert float(kl_divergence(shifted, standard)) == 4.5  # 3^2 / 2
    wide = Gaussian(torch.zeros(1), torch.tensor([math.log(4.0)]))  # a standard deviation of 2
    # KL(N(0, 4) || N(0, 1)) = (4 - 1 - ln 4) / 2; KL(N(3, 1) || N(0, 4)) = (ln 4 + 1 / 4 + 9 / 4 -
    # 1) / 2
    torch.testing.assert_close(float(kl_divergence(wide, standard)), 0.5 * (3 - math.log(4)))
    torch.testing.assert_close(float(kl_divergence(shifted, wide)), 0.5 * (math.log(4) + 1.5))


def test_draws_have_the_mean_and_deviation_asked_for() -> None:
    torch.manual_seed(0)
    draws = Gaussian(torch.full((20000,), 5.0), torch.full((20000,), math.log(0.25))).sample()
    assert abs(float(draws.mean()) - 5.0) < 0.02
    assert abs(float(draws.std()) - 0.5) < 0.02


def test_gradients_reach_mean_and_variance() -> None:
    mean, log_variance = torch.zeros(1, requires_grad=True), torch.zeros(1, requires_grad=True)
    Gaussian(mean, log_variance).sample(torch.tensor([2.0])).sum().backward()
    assert (float(mean.grad), float(log_variance.grad)) == (
        1.0,
        1.0,
    )  # d/dv of exp(v / 2) * 2 at 0 is 1


def test_steps_one_by_one_are_the_same_as_all_at_once() -> None:
    torch.manual_seed(0)
    lstm = Lstm(3, 5, 2, 4)
    numbers = torch.randn(2, 6, 3)
    whole, _ = lstm(numbers)
    _, memory = lstm(numbers[:, :4])
    fifth, memory = lstm.step(numbers[:, 4], memory)
    sixth, _ = lstm.step(numbers[:, 5], memory)
    torch.testing.assert_close(torch.stack([fifth, sixth], dim=1), whole[:, 4:])
