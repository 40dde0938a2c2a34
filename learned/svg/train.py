"""How SVG learns: squared error under the posterior, and the posterior's distance from the prior."""

from __future__ import annotations

from dataclasses import dataclass, field

from torch import Tensor, nn
from torch.nn import functional

from learned.methods import Losses
from learned.svg.network import Architecture, Learned, SvgNetwork
from learned.video.latents import divergence
from learned.video.training import VideoTraining


@dataclass(frozen=True)
class SvgTraining(VideoTraining):
    """SVG-LP; `beta` weighs the latents' nats against the mean squared error of pixel values in [0, 1]."""

    architecture: Architecture = field(default_factory=Architecture)
    beta: float = 1e-4

    @property
    def size_px(self) -> int:
        """The side of the network's square images."""
        return self.architecture.coding.size_px

    def build(self) -> dict[str, nn.Module]:
        """The fresh network."""
        return {"video": SvgNetwork(self.architecture)}

    def losses(self, network: nn.Module, images: Tensor) -> Losses:
        """Means over clips and predicted frames."""
        learned: Learned = network(images, self.num_past)
        error = functional.mse_loss(learned.images, images[:, 1:])
        nats = divergence(learned.posterior, learned.prior).mean()
        return {"total": error + self.beta * nats, "error": error, "nats": nats}
