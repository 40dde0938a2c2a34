"""Training of DeepVO on the loss of absolute poses (thesis, eq. 3.4 to 3.6)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim import Optimizer

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, Intrinsics
from geovp_learned import inert_pickle, stored_clips
from geovp_learned.deepvo import windows
from geovp_learned.deepvo.network import Architecture, PoseNetwork, chained, motions, squared_errors
from geovp_learned.deepvo.windows import NO_AUGMENTATION, Augmentation
from geovp_learned.methods import Batch, Losses, Networks
from geovp_learned.stored_clips import Arrays, Window


@dataclass(frozen=True)
class DeepVoTraining:
    """Settings of the pose network's training.

    With `auxiliary` the loss also has the error of the past poses, which trains the encoder alone.
    `loss` "relative" compares single steps instead of absolute poses. Squared errors of the
    absolute pose after n steps are divided by n ** `drift_power`: 0 as published, where late poses
    dominate; 2 compares the drift per step. Each batch has a random number of observed frames,
    `shortest_past` to `num_past`. Wang et al. 2017 train with Adagrad from FlowNet's weights.
    """

    architecture: Architecture = field(default_factory=Architecture)
    augmentation: Augmentation = field(default_factory=Augmentation)
    num_past: int = 10
    num_future: int = 10
    shortest_past: int = 10
    loss: Literal["absolute", "relative"] = "absolute"
    auxiliary: bool = True
    drift_power: float = 0.0  # of absolute poses
    rotation_weight: float = 100.0  # of rad^2 against m^2, eq. 3.6
    rate: float = 1e-3
    weight_decay: float = 1e-4
    optimiser: Literal["adamw", "adagrad"] = "adamw"
    flownet: Path | None = (
        None  # weights of FlowNetS-BN (flownets_bn_EPE2.459.pth.tar) to start from
    )

    def __post_init__(self) -> None:
        if not 2 <= self.shortest_past <= self.num_past:
            raise BadData(
                f"shortest_past is {self.shortest_past}, expected 2 to num_past ({self.num_past})"
            )

    def build(self) -> dict[str, nn.Module]:
        """Build the pose network; raise BadData if FlowNet's weights do not fit its encoder."""
        network = PoseNetwork(self.architecture)
        if self.flownet is not None:
            load_flownet(network.encoder, self.flownet)
        return {"poses": network}

    def optimisers(self, networks: Networks) -> dict[str, Optimizer]:
        """Build the optimiser of the network."""
        parameters = networks["poses"].parameters()
        if self.optimiser == "adagrad":
            return {"poses": torch.optim.Adagrad(parameters, self.rate)}
        return {"poses": torch.optim.AdamW(parameters, self.rate, weight_decay=self.weight_decay)}

    def prepare(self, clip: Clip) -> Arrays:
        """Return frames for the network's camera, and poses."""
        return windows.prepare(clip, self.architecture.camera)

    def examples(self, clips: Sequence[Arrays], *, training: bool) -> Sequence[Window]:
        """Cut windows from the clips: all for training, every fifth for validation."""
        num_frames = self.num_past + self.num_future
        return stored_clips.windows(clips, num_frames, 1 if training else 5)

    def example(self, item: Window, rng: np.random.Generator) -> Batch:
        """Return an augmented window."""
        return windows.sample(item, *self._sizes, self.augmentation, rng)

    def training_step(self, networks: Networks, batch: Batch, step: int) -> dict[str, Losses]:
        """Return the losses of the only network, shown a random number of observed frames."""
        skipped = int(torch.randint(self.num_past - self.shortest_past + 1, ()))
        parts = {name: tensor[:, skipped:] for name, tensor in batch.items()}
        past, future = networks["poses"](parts["images"].float() / 255.0, self.num_future)
        return {"poses": self.losses(past, future, parts["motions"], parts["is_known"])}

    def losses(
        self,
        past: Tensor,  # [B, P - 1, D] steps
        future: Tensor,  # [B, F, D]
        real: Tensor,  # [B, P + F - 1, 4, 4]
        weights: Tensor,  # [B, P + F - 1]; 0 for a step that is not learnt
    ) -> Losses:
        """Return the losses of eq. 3.6 as means over the past's and the future's valid steps."""
        head = self.architecture.head
        predicted = motions(torch.cat([past, future], dim=1).float(), head)
        if self.loss == "absolute":
            predicted, real = chained(predicted), chained(real)
            lengths = torch.arange(1, weights.shape[1] + 1, device=weights.device)
            weights = weights / lengths**self.drift_power
        translation, rotation = squared_errors(predicted, real, head)
        both = translation + self.rotation_weight * rotation
        split = past.shape[1]
        losses = {
            "past": _mean(both[:, :split], weights[:, :split]),
            "future": _mean(both[:, split:], weights[:, split:]),
        }
        return {"total": losses["future"] + (losses["past"] if self.auxiliary else 0.0), **losses}

    def validation_example(self, item: Window) -> Batch:
        """Return a window as it is."""
        return windows.sample(item, *self._sizes, NO_AUGMENTATION, np.random.default_rng(0))

    def validation_step(self, networks: Networks, batch: Batch) -> Losses:
        """Return mean errors of future poses, seen from the last observed camera, and of single
        past steps, in m and deg; the score is the sum of the future's.
        """
        past, future = networks["poses"](batch["images"].float() / 255.0, self.num_future)
        head, split, real = self.architecture.head, past.shape[1], batch["motions"]
        ahead = squared_errors(chained(motions(future, head)), chained(real[:, split:]), head)
        behind = squared_errors(motions(past, head), real[:, :split], head)
        future_m, future_rad, past_m, past_rad = (
            squares.sqrt().mean() for squares in (*ahead, *behind)
        )
        future_deg = torch.rad2deg(future_rad)
        return {
            "score": future_m + future_deg,
            "future_m": future_m,
            "future_deg": future_deg,
            "past_step_m": past_m,
            "past_step_deg": torch.rad2deg(past_rad),
        }

    @property
    def _sizes(self) -> tuple[Intrinsics, int, int]:
        return self.architecture.camera, self.num_past, self.num_future


def load_flownet(encoder: nn.Module, file: Path) -> None:
    """Load the contracting part of FlowNetS with batch normalisation, whose layers are in the order
    of the encoder's; inputs are in [-0.5, 0.5] as there.
    """
    content = inert_pickle.load(file)
    stored = inert_pickle.state_dict(content.get("state_dict", content))
    theirs = [
        value
        for key, value in stored.items()
        if key.startswith("conv") and not key.endswith("batches_tracked")
    ]
    names = [key for key in encoder.state_dict() if not key.endswith("batches_tracked")]
    with files.checked(f"{file} does not fit the encoder", "give FlowNetS-BN and encoder_width 1"):
        encoder.load_state_dict(dict(zip(names, theirs, strict=True)), strict=False)


def _mean(values: Tensor, weights: Tensor) -> Tensor:
    """Return the weighted mean over the values of positive weight; 0 if there are none."""
    return (values * weights).sum() / (weights > 0).sum().clamp(min=1)
