"""SLAMP: stochastic latent appearance and motion prediction (Akan et al. 2021).

One branch predicts the next frame, one the optical flow that moves the last frame, and a mask
blends the two. The mask network has three plain convolutions; the authors'
(github.com/kaanakan/slamp, models/mask_predictor.py) has five with batch normalisation and
squeeze-and-excitation.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.distributions import Normal, kl_divergence
from torch.nn import functional

from geovp_learned.methods import Losses
from geovp_learned.tensors import pixel_grid, sample_images
from geovp_learned.video import svg
from geovp_learned.video.svg import RecurrentAutoencoder, Rollout
from geovp_learned.video.training import VideoNetwork, VideoTraining


@dataclass(frozen=True)
class Architecture(svg.Architecture):
    """Sizes of the networks; `latent_size` is of each branch. The flow is the decoder's output
    times `flow_unit_px`.
    """

    mask_width: int = 32
    flow_unit_px: float = 1.0


class Blend(NamedTuple):
    """Images [..., 3, H, W] of each branch and blended."""

    images: Tensor
    appearance: Tensor
    motion: Tensor  # the previous frames, warped


class Output(NamedTuple):
    """Predictions of all steps but the first, and posterior and prior of the latents of each
    branch.
    """

    prediction: Blend  # [B, T - 1, ...]
    appearance: tuple[Normal, Normal]  # [B, T - 1, latent_size]
    motion: tuple[Normal, Normal]


class SlampNetwork(VideoNetwork):
    """The appearance branch sees frames, the motion branch pairs of consecutive frames."""

    def __init__(self, architecture: Architecture) -> None:
        """Build the model with new weights; a residual network starts with no flow."""
        super().__init__(architecture.coding, 2 * architecture.latent_size)
        self.flow_unit_px, width = architecture.flow_unit_px, architecture.mask_width
        self.appearance = RecurrentAutoencoder(architecture, in_channels=3, out_channels=3)
        self.motion = RecurrentAutoencoder(architecture, in_channels=6, out_channels=2)
        self.mask = nn.Sequential(
            nn.Conv2d(6, width, 3, padding=1),
            nn.LeakyReLU(0.2),
            nn.Conv2d(width, width, 3, padding=1),
            nn.LeakyReLU(0.2),
            nn.Conv2d(width, 1, 3, padding=1),
        )

    def forward(self, images: Tensor, num_past: int) -> Output:
        """Predict from the real frames [B, T, 3, H, W] before each; skips are of observed frames
        only.
        """
        skip_steps = torch.arange(images.shape[1] - 1, device=images.device).clamp(max=num_past - 1)
        maps, appearance = self.appearance.teacher_forced(images, skip_steps)
        flow, motion = self.motion.teacher_forced(_frame_pairs(images), skip_steps)
        flat = self._blend(
            maps, flow, images[:, skip_steps].flatten(0, 1), images[:, :-1].flatten(0, 1)
        )
        prediction = Blend(*(tensor.unflatten(0, (len(images), -1)) for tensor in flat))
        return Output(prediction, appearance, motion)

    def predict(self, observed: Tensor, noise: Tensor) -> Tensor:
        """Predict futures [N, F, 3, H, W], each frame from those predicted before it."""
        appearance = Rollout(self.appearance, observed)
        motion = Rollout(self.motion, _frame_pairs(observed))
        frames = list(observed[:, -2:].unbind(dim=1))
        for step, step_noise in enumerate(noise.split(1, dim=1)):
            if step > 0:
                appearance.feed_back(frames[-1])
                motion.feed_back(torch.cat(frames[-2:], dim=1))
            appearance_noise, motion_noise = step_noise.chunk(2, dim=-1)
            maps, flow = appearance.step(appearance_noise), motion.step(motion_noise)
            frames.append(self._blend(maps, flow, observed[:, -1], frames[-1]).images)
        return torch.stack(frames[2:], dim=1)

    def _blend(self, maps: Tensor, flow: Tensor, base: Tensor, previous: Tensor) -> Blend:
        """Blend predictions [N, ...] of decoded maps and flow; the flow warps the `previous` frames
        [N, 3, H, W].
        """
        appearance = self.images(maps, base)
        motion = warp(previous, flow * self.flow_unit_px)
        masks = torch.sigmoid(self.mask(torch.cat([appearance, motion], dim=1)))
        return Blend(masks * appearance + (1 - masks) * motion, appearance, motion)


@dataclass(frozen=True)
class SlampTraining(VideoTraining):
    """Training of SLAMP; weights are relative to the mean squared error of the blended frames."""

    architecture: Architecture = field(default_factory=Architecture)
    beta: float = 1e-4  # of both branches' KL divergence
    appearance_weight: float = 1.0
    motion_weight: float = 1.0

    network = SlampNetwork

    def losses(self, network: nn.Module, images: Tensor) -> Losses:
        """Return means over clips and predicted frames."""
        output: Output = network(images, self.num_past)
        nats = torch.stack(
            [kl_divergence(*both).sum(-1).mean() for both in (output.appearance, output.motion)]
        ).sum()
        error, appearance, motion = (
            functional.mse_loss(shown, images[:, 1:]) for shown in output.prediction
        )
        weighted = self.appearance_weight * appearance + self.motion_weight * motion
        return {
            "total": error + weighted + self.beta * nats,
            "error": error,
            "appearance": appearance,
            "motion": motion,
            "nats": nats,
        }


def warp(images: Tensor, flow_px: Tensor) -> Tensor:
    """Warp backwards: each pixel of [N, C, H, W] shows what lies `flow_px` [N, 2, H, W] (right,
    down) from it.
    """
    grid = pixel_grid(images.shape[2:], flow_px)
    return sample_images(images, grid + flow_px.movedim(1, -1))


def _frame_pairs(images: Tensor) -> Tensor:
    """Stack each frame behind its predecessor [B, T, 6, H, W]; the first frame is its own
    predecessor.
    """
    return torch.cat([torch.cat([images[:, :1], images[:, :-1]], dim=1), images], dim=2)
