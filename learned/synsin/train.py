"""How SynSin is trained: pairs of frames with their motion, no depth needed (Wiles et al. 2020; thesis, eq. 3.7)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim import Adam, Optimizer

from geovp_classic.errors import BadData
from geovp_classic.types import Clip
from learned.lpips import Net
from learned.methods import Batch, Losses, Networks
from learned.synsin import discriminator, losses, pairs, reprojection
from learned.synsin.discriminator import MultiScaleDiscriminator
from learned.synsin.network import Architecture, Generator
from learned.synsin.pairs import Example, Scene

Turn = tuple[str, Losses]


@dataclass(frozen=True)
class Weights:
    """How much each loss counts; one of weight 0 is not computed."""

    colour: float = 1.0
    content: float = 10.0
    adversarial: float = 1.0
    feature_matching: float = 10.0  # of the discriminator's features, within the adversarial loss
    depth: float = 0.0  # from here on not in the paper: where a data set knows depth, as the synthetic street does
    reprojection: float = 0.0  # see the module of that name
    roughness: float = 0.0  # of depth


@dataclass(frozen=True)
class SynSinTraining:
    """Settings of training; each example shows `views` of its next `max_horizon` frames, drawn at random."""

    architecture: Architecture = field(default_factory=Architecture)
    weights: Weights = field(default_factory=Weights)
    content_net: Net = "squeeze"
    max_horizon: int = 20
    views: int = 2
    near_share: float = 0.5  # of examples whose first view is of the nearest quarter of horizons, for depth's sake
    depth_first_steps: int = 0  # in which only depth learns, from its own losses
    depth_share: float = 1.0  # of the images' gradient, how much depth learns from; 1 is the paper's
    grey_share: float = 0.2  # of examples shown without colours
    rate: float = 1e-3
    discriminator_rate: float = 2e-3
    discriminator_width: int = 64
    validation_stride: int = 20  # frames between two examples that validation looks at

    def __post_init__(self) -> None:
        """Raise BadData for settings that train nothing."""
        for name in ("max_horizon", "views", "validation_stride"):
            if getattr(self, name) < 1:
                raise BadData(f"{name} is {getattr(self, name)}, expected 1 or more")

    @property
    def kept(self) -> tuple[str, ...]:
        """The discriminator only serves training."""
        return ("generator",)

    def build(self) -> dict[str, nn.Module]:
        """A fresh generator, and a discriminator when the adversarial loss counts."""
        networks: dict[str, nn.Module] = {"generator": Generator(self.architecture)}
        if self.weights.adversarial:
            networks["discriminator"] = MultiScaleDiscriminator(self.discriminator_width)
        return networks

    def optimisers(self, networks: Networks) -> dict[str, Optimizer]:
        """Adam with momenta (0, 0.9) under an adversary, as the paper, with the usual (0.9, 0.99) without one."""
        betas = (0.0, 0.9) if self.weights.adversarial else (0.9, 0.99)
        rates = {"generator": self.rate, "discriminator": self.discriminator_rate}
        return {name: Adam(network.parameters(), lr=rates[name], betas=betas) for name, network in networks.items()}

    def examples(self, clips: Iterable[Clip], *, training: bool) -> Sequence[Example]:
        """Every frame with enough frames after it; in validation, one in `validation_stride`."""
        return pairs.examples(clips, self.max_horizon)[:: 1 if training else self.validation_stride]

    def batch(self, examples: Sequence[Example], indices: Sequence[int], rng: np.random.Generator) -> Batch:
        """The chosen examples with horizons drawn from `rng`, some mirrored, some grey."""
        return pairs.batch([self._drawn(examples[index], rng) for index in indices])

    def training_step(self, networks: Networks, batch: Batch, step: int) -> Iterator[Turn]:
        """The generator, then the discriminator on what that made."""
        if step < self.depth_first_steps:
            _, inverse_depths = networks["generator"](batch["frames"], batch["intrinsics"])
            yield "generator", self._summed(self._depth_losses(inverse_depths, batch))
            return
        motion = (batch["intrinsics"], batch["cam_from_last"])
        images, inverse_depths = networks["generator"](batch["frames"], *motion, self.depth_share)
        made, real = images.frames, batch["targets"]
        judge = networks.get("discriminator")
        parts = {**self._losses(made, real), **self._depth_losses(inverse_depths, batch)}
        if judge is not None:
            parts |= adversarial(judge, made, real)
        yield "generator", self._summed(parts)
        if judge is not None:
            yield "discriminator", {"total": discriminator.hinge_of_discriminator(judge(real), judge(made.detach()))}

    def validate(self, networks: Networks, examples: Sequence[Example]) -> dict[str, float]:
        """PSNR and losses at some horizons; the score is colour and content, weighted as in training."""
        horizons = sorted({max(1, round(share * self.max_horizon)) for share in (0.05, 0.25, 0.5, 0.75, 1.0)})
        torch.manual_seed(0)  # noise of the refinement network
        device = next(networks["generator"].parameters()).device
        rows: list[dict[str, float]] = []
        for example in examples:
            batch = {name: part.to(device) for name, part in pairs.batch([pairs.scene(example, horizons)]).items()}
            made = networks["generator"](batch["frames"], batch["intrinsics"], batch["cam_from_last"])[0].frames.clamp(
                0, 1
            )
            parts = self._losses(made, batch["targets"])
            summed = {name: float(part) for name, part in self._summed(parts).items()}
            rows.append({**summed, "psnr": float(losses.psnr_db(made, batch["targets"]).mean())})
        means = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
        return {"score": means.pop("total"), **means}

    def _drawn(self, example: Example, rng: np.random.Generator) -> Scene:
        horizons = 1 + rng.choice(self.max_horizon, self.views, replace=self.views > self.max_horizon)
        if rng.random() < self.near_share:
            horizons[0] = rng.integers(1, max(self.max_horizon // 4, 1) + 1)
        return pairs.augmented(pairs.scene(example, horizons.tolist()), rng, self.grey_share)

    def _losses(self, made: Tensor, real: Tensor) -> Losses:
        parts = {"colour": losses.colour_loss(made, real)}
        if self.weights.content:
            parts["content"] = losses.content_loss(made, real, self.content_net)
        return parts

    def _depth_losses(self, inverse_depths: Tensor, batch: Batch) -> Losses:
        parts = {}
        if self.weights.depth:
            parts["depth"] = losses.depth_loss(inverse_depths, batch["inverse_depths"])
        if self.weights.reprojection:
            seen = (batch["frames"], batch["targets"], batch["cam_from_last"], batch["intrinsics"])
            parts["reprojection"] = reprojection.reprojection_loss(inverse_depths, *seen)
        if self.weights.roughness:
            parts["roughness"] = reprojection.roughness(inverse_depths, batch["frames"])
        return parts

    def _summed(self, parts: Losses) -> Losses:
        """The parts with their weighted sum as "total"."""
        weights = {
            "colour": self.weights.colour,
            "content": self.weights.content,
            "depth": self.weights.depth,
            "reprojection": self.weights.reprojection,
            "roughness": self.weights.roughness,
            "adversarial": self.weights.adversarial,
            "feature_matching": self.weights.adversarial * self.weights.feature_matching,
        }
        return {**parts, "total": torch.stack([weights[name] * part for name, part in parts.items()]).sum()}


def adversarial(judge: nn.Module, made: Tensor, real: Tensor) -> Losses:
    """What the discriminator adds to the generator's losses."""
    with torch.no_grad():
        wanted = judge(real)
    judgements = judge(made)
    return {
        "adversarial": discriminator.hinge_of_generator(judgements),
        "feature_matching": discriminator.feature_distance(wanted, judgements),
    }
