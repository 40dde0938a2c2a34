"""Training of DeepVO on the loss of absolute poses (thesis, eq. 3.4 to 3.6)."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim import Optimizer

from geovp_classic import files
from geovp_classic.geometry import se3
from geovp_classic.types import Clip
from geovp_learned import inert_pickle, stored_clips
from geovp_learned.deepvo.network import Architecture, PoseNetwork, chained, motions, squared_errors
from geovp_learned.methods import Batch, Losses, Networks
from geovp_learned.stored_clips import Arrays, Window
from geovp_learned.tensors import bytes_from_frames, grey, metric_trajectory, seen_by


@dataclass(frozen=True)
class DeepVoTraining:
    """Settings of the pose network's training.

    With `auxiliary` the loss also has the error of the past poses, which trains the encoder alone.
    `loss` "relative" compares single steps instead of absolute poses. Wang et al. 2017 start from
    FlowNet's weights.
    """

    architecture: Architecture = field(default_factory=Architecture)
    num_past: int = 10
    num_future: int = 10
    loss: Literal["absolute", "relative"] = "absolute"
    auxiliary: bool = True
    rotation_weight: float = 100.0  # of rad^2 against m^2, eq. 3.6
    grey_probability: float = 0.0  # probability that a window is shown without colours
    rate: float = 5e-4
    # Weights of FlowNetS-BN (flownets_bn_EPE2.459.pth.tar) to start from
    flownet: Path | None = None

    def build(self) -> dict[str, nn.Module]:
        """Build the pose network; raise BadData if FlowNet's weights do not fit its encoder."""
        network = PoseNetwork(self.architecture)
        if self.flownet is not None:
            load_flownet(network.encoder, self.flownet)
        return {"poses": network}

    def optimisers(self, networks: Networks) -> dict[str, Optimizer]:
        """Build Adagrad, as Wang et al. 2017."""
        return {"poses": torch.optim.Adagrad(networks["poses"].parameters(), self.rate)}

    def prepare(self, clip: Clip) -> Arrays:
        """Return poses, and frames as of the network's camera; BadData if poses are not metric."""
        camera, wanted = clip.intrinsics, self.architecture.camera
        return {
            "frames": np.stack([seen_by(frame, camera, wanted) for frame in clip.frames]),
            "world_from_cam": metric_trajectory(clip).world_from_cam,
        }

    def examples(self, clips: Sequence[Arrays], *, training: bool) -> Sequence[Window]:
        """Cut windows from the clips: all for training, every fifth for validation."""
        num_frames = self.num_past + self.num_future
        return stored_clips.windows(clips, num_frames, 1 if training else 5)

    def example(self, item: Window, rng: np.random.Generator) -> Batch:
        """Return a window: "images" [P, 3, H, W] of bytes and "motions" [P + F - 1, 4, 4]."""
        first, end = item.first, item.first + self.num_past
        frames = item.clip["frames"][first:end]
        world_from_cam = item.clip["world_from_cam"][first : end + self.num_future]
        relative = se3.inverse(world_from_cam[:-1]) @ world_from_cam[1:]
        return {
            "images": bytes_from_frames(
                grey(frames) if rng.random() < self.grey_probability else frames
            ),
            "motions": torch.from_numpy(relative).float(),
        }

    def training_step(self, networks: Networks, batch: Batch, step: int) -> dict[str, Losses]:
        """Return the losses of the only network."""
        past, future = networks["poses"](batch["images"].float() / 255.0, self.num_future)
        return {"poses": self.losses(past, future, batch["motions"])}

    def losses(
        self,
        past: Tensor,  # [B, P - 1, D] steps
        future: Tensor,  # [B, F, D]
        real: Tensor,  # [B, P + F - 1, 4, 4]
    ) -> Losses:
        """Return the losses of eq. 3.6 as means over the past's and the future's steps."""
        head = self.architecture.head
        predicted = motions(torch.cat([past, future], dim=1).float(), head)
        if self.loss == "absolute":
            predicted, real = chained(predicted), chained(real)
        translation, rotation = squared_errors(predicted, real, head)
        both = translation + self.rotation_weight * rotation
        split = past.shape[1]
        losses = {"past": both[:, :split].mean(), "future": both[:, split:].mean()}
        return {"total": losses["future"] + (losses["past"] if self.auxiliary else 0.0), **losses}

    def validation_example(self, item: Window) -> Batch:
        """Return a window as it is."""
        return replace(self, grey_probability=0.0).example(item, np.random.default_rng(0))

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
