"""How SRVP learns: the evidence lower bound of all frames, and small residuals."""

from __future__ import annotations

from dataclasses import dataclass, field

from torch import Tensor, nn

from learned.methods import Losses
from learned.srvp.network import Architecture, Learned, SrvpNetwork
from learned.video.latents import Gaussian, divergence
from learned.video.training import VideoTraining


@dataclass(frozen=True)
class SrvpTraining(VideoTraining):
    """SRVP; with all betas 1 the bound is that of the model, in nats.

    Residuals are penalised as in the authors' code (github.com/edouardelasalles/srvp, train.py): by the sum of their
    Euclidean lengths, one of every Euler step. Losses are divided by the number of a clip's values, so that they
    compare with those of the other methods.
    """

    architecture: Architecture = field(default_factory=Architecture)
    observation_std: float = 1.0  # of a pixel's value around what is shown
    beta_first: float = 1.0  # of the first state's nats
    beta: float = 1.0  # of the latents' nats
    residual_weight: float = 1.0  # of the residuals' length

    @property
    def size_px(self) -> int:
        """The side of the network's square images."""
        return self.architecture.coding.size_px

    def build(self) -> dict[str, nn.Module]:
        """The fresh network."""
        return {"video": SrvpNetwork(self.architecture)}

    def losses(self, network: nn.Module, images: Tensor) -> Losses:
        """Nats of a clip, per value of it."""
        learned: Learned = network(images, self.num_past)
        values, per_clip = images[0].numel(), (1, 2, 3, 4)
        errors = 0.5 * ((learned.images - images) / self.observation_std).square().sum(per_clip).mean()
        first = divergence(learned.first, Gaussian.standard(learned.first.mean)).mean()
        nats = divergence(learned.posterior, learned.prior).sum(1).mean()
        lengths = learned.residuals.norm(dim=-1).sum((1, 2)).mean()
        total = errors + self.beta_first * first + self.beta * nats + self.residual_weight * lengths
        parts = {"total": total, "error": errors, "first_nats": first, "nats": nats, "residual": lengths}
        return {name: part / values for name, part in parts.items()}
