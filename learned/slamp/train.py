"""How SLAMP learns: squared errors of both branches and of what they make together, and the nats of both latents."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor, nn
from torch.nn import functional

from learned.methods import Losses
from learned.slamp.network import Architecture, Learned, SlampNetwork
from learned.video.latents import divergence
from learned.video.training import VideoTraining


@dataclass(frozen=True)
class SlampTraining(VideoTraining):
    """SLAMP; weights are against the squared error of the combined frames."""

    architecture: Architecture = field(default_factory=Architecture)
    beta: float = 1e-4  # of both branches' nats
    appearance_weight: float = 1.0
    motion_weight: float = 1.0

    @property
    def size_px(self) -> int:
        """The side of the network's square images."""
        return self.architecture.coding.size_px

    def build(self) -> dict[str, nn.Module]:
        """The fresh network."""
        return {"video": SlampNetwork(self.architecture)}

    def losses(self, network: nn.Module, images: Tensor) -> Losses:
        """Means over clips and predicted frames."""
        learned: Learned = network(images, self.num_past)
        real, shown = images[:, 1:], learned.shown
        parts = {
            "error": functional.mse_loss(shown.images, real),
            "appearance": functional.mse_loss(shown.appearance, real),
            "motion": functional.mse_loss(shown.motion, real),
            "nats": torch.stack(
                [divergence(a, b).mean() for a, b in zip(learned.posteriors, learned.priors, strict=True)]
            ).sum(),
        }
        weights = {
            "error": 1.0,
            "appearance": self.appearance_weight,
            "motion": self.motion_weight,
            "nats": self.beta,
        }
        total = torch.stack([weights[name] * part for name, part in parts.items()]).sum()
        return {"total": total, **parts}
