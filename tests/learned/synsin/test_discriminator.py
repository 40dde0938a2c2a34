import pytest
import torch

from geovp_learned.synsin import discriminator
from geovp_learned.synsin.discriminator import MultiScaleDiscriminator


def scale(*scores: float) -> list[torch.Tensor]:
    """One scale's: a map of ones as features, then scores."""
    return [torch.ones(1, 1, 2, 2), torch.tensor(scores)]


def test_every_scale_judges_patches_of_a_image_half_as_large() -> None:
    outputs = MultiScaleDiscriminator(width=4)(torch.rand(2, 3, 64, 64))
    # 4x4 kernels padded by two: n / 2 + 1 pixels with a stride, thrice, then n + 1 without, twice
    assert [tuple(one[-1].shape) for one in outputs] == [(2, 1, 11, 11), (2, 1, 7, 7)]
    assert [[maps.shape[1] for maps in one] for one in outputs] == [[4, 8, 16, 32, 1]] * 2


def test_hinge_of_the_discriminator_stops_at_a_margin_of_one() -> None:
    real, made = [scale(3.0, 0.5), scale(1.0, 1.0)], [scale(-2.0, -1.0), scale(0.0, 0.0)]
    # first scale: (0 + 0.5) / 2 + 0; second: 0 + 1
    assert float(discriminator.discriminator_hinge_loss(real, made)) == pytest.approx(
        (0.25 + 1.0) / 2
    )


class Critic(torch.nn.Module):
    """A critic of one scale with one feature."""

    def forward(self, frames: torch.Tensor) -> list[list[torch.Tensor]]:
        return [[1.0 * frames, frames.mean() ** 3]]


def test_features_are_compared_without_the_scores_and_teach_the_generator_only() -> None:
    real, made = (
        torch.full((1, 1, 2, 2), 3.0, requires_grad=True),
        torch.ones(1, 1, 2, 2, requires_grad=True),
    )
    distance = discriminator.generator_losses(Critic(), made, real)["feature_matching"]
    assert float(distance.detach()) == pytest.approx(2.0)
    distance.backward()
    assert real.grad is None
    assert made.grad is not None
