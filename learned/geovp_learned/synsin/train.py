"""Training of SynSin on pairs of frames with their motion, without depth (Wiles et al. 2020;
thesis, eq. 3.7).
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.optim import Adam, Optimizer

from geovp_classic.types import Clip
from geovp_learned.methods import Batch, Losses, Networks
from geovp_learned.stored_clips import Arrays, Window, windows
from geovp_learned.synsin import discriminator, losses, pairs
from geovp_learned.synsin.discriminator import MultiScaleDiscriminator
from geovp_learned.synsin.generator import Generator
from geovp_learned.synsin.network import Architecture
from geovp_learned.tensors import psnr_db


@dataclass(frozen=True)
class Weights:
    """Weights of the losses; without `adversarial` there is no discriminator."""

    colour: float = 1.0
    content: float = 10.0
    adversarial: float = 1.0
    feature_matching: float = 10.0


@dataclass(frozen=True)
class SynSinTraining:
    """Settings of training; the target of an example is a random one of its next `max_horizon`
    frames. The authors draw it from the five frames before and after, and do not mirror.
    """

    architecture: Architecture = field(default_factory=Architecture)
    weights: Weights = field(default_factory=Weights)
    content_net: losses.ContentNet = "squeeze"
    max_horizon: int = 20
    mirror_probability: float = 0.5
    grey_probability: float = 0.2  # probability that an example is shown without colours
    # Of Adam; base_model.py of the authors has (0, 0.9) with an adversary and (0.99, 0.9) without.
    # The default is that of synsin-small, whose file does not name it.
    betas: tuple[float, float] = (0.9, 0.99)
    rate: float = 1e-3
    discriminator_rate: float = 2e-3
    discriminator_width: int = 64
    validation_stride: int = 20  # frames between two validation examples

    def build(self) -> dict[str, nn.Module]:
        """Build a new generator, and a discriminator if the adversarial loss has a weight."""
        networks: dict[str, nn.Module] = {"generator": Generator(self.architecture)}
        if self.weights.adversarial:
            networks["discriminator"] = MultiScaleDiscriminator(self.discriminator_width)
        return networks

    def optimisers(self, networks: Networks) -> dict[str, Optimizer]:
        """Build Adam for each network."""
        rates = {"generator": self.rate, "discriminator": self.discriminator_rate}
        return {
            name: Adam(network.parameters(), lr=rates[name], betas=self.betas)
            for name, network in networks.items()
        }

    def prepare(self, clip: Clip) -> Arrays:
        """Return frames, poses and camera."""
        return pairs.prepare(clip)

    def examples(self, clips: Sequence[Arrays], *, training: bool) -> Sequence[Window]:
        """Return all frames with enough frames after them; in validation, every
        `validation_stride`-th of a clip.
        """
        return windows(clips, 1 + self.max_horizon, 1 if training else self.validation_stride)

    def example(self, item: Window, rng: np.random.Generator) -> Batch:
        """Return an example with a horizon drawn from `rng`, some mirrored, some grey."""
        horizon = int(rng.integers(1, self.max_horizon + 1))
        mirrored, in_grey = rng.random(2) < (self.mirror_probability, self.grey_probability)
        return pairs.frame_pairs(item, [horizon], mirrored=mirrored, in_grey=in_grey)

    def training_step(self, networks: Networks, batch: Batch, step: int) -> dict[str, Losses]:
        """Return the generator's losses, and the discriminator's on the generated images."""
        fake, real = self._images(networks, batch)
        terms = self._image_losses(fake, real)
        if "discriminator" not in networks:
            return {"generator": self._summed(terms)}
        critic = networks["discriminator"]
        terms |= discriminator.generator_losses(critic, fake, real)
        loss = discriminator.discriminator_hinge_loss(critic(real), critic(fake.detach()))
        return {"generator": self._summed(terms), "discriminator": {"total": loss}}

    def validation_example(self, item: Window) -> Batch:
        """Return an example at the first and every fifth horizon."""
        return pairs.frame_pairs(item, [1, *range(5, self.max_horizon + 1, 5)])

    def validation_step(self, networks: Networks, batch: Batch) -> Losses:
        """Return PSNR and losses; the score is colour and content, weighted as in training."""
        fake, real = self._images(networks, batch)
        terms = self._summed(self._image_losses(fake, real))
        return {"score": terms.pop("total"), **terms, "psnr": psnr_db(fake, real).mean()}

    def _images(self, networks: Networks, batch: Batch) -> tuple[Tensor, Tensor]:
        """Return generated and true images [B * V, 3, H, W]."""
        inputs = (batch[name] for name in ("frames", "intrinsics", "cam_from_last"))
        return networks["generator"](*inputs).frames, batch["targets"].flatten(0, 1)

    def _image_losses(self, fake: Tensor, real: Tensor) -> Losses:
        parts = {"colour": functional.l1_loss(fake, real)}
        if self.weights.content:
            parts["content"] = losses.content_loss(fake, real, self.content_net)
        return parts

    def _summed(self, parts: Losses) -> Losses:
        """Add the weighted sum of the terms as "total"."""
        weights = asdict(self.weights)
        total = torch.stack([weights[name] * loss for name, loss in parts.items()]).sum()
        return {**parts, "total": total}
