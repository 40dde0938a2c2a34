import pytest
import torch

from geovp_learned.synsin import discriminator


def scale(*scores: float) -> list[torch.Tensor]:
    """One scale's: a map of ones as features, then scores."""
    return [torch.ones(1, 1, 2, 2), torch.tensor(scores)]


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
