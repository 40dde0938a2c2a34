"""SLAMP: stochastic latent appearance and motion prediction (Akan et al. 2021).

One branch predicts the next frame, one the optical flow that moves the last frame, and a mask
blends the two. Networks, loss and generation are those of the authors' repository (kaanakan/slamp:
models/, helpers.py, flow_utils.py), and so are the names of the modules. As with SVG, the authors
normalise by the statistics of a batch of test clips, we by those of training.
"""

import math
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import torch
from torch import Tensor, nn
from torch.distributions import Normal
from torch.nn import functional

from geovp_learned.methods import Losses
from geovp_learned.tensors import pixel_grid
from geovp_learned.video.autoencoder import Decoder, Encoder, initialise
from geovp_learned.video.driving_networks import (
    SIZES_PX,
    GridDecoder,
    ImageEncoder,
    MaskNetwork,
    SpatialEncoder,
)
from geovp_learned.video.latents import GaussianLstm, LstmPredictor, Memory, drawn, summed_nats
from geovp_learned.video.training import VideoArchitecture, VideoNetwork, VideoTraining

MIN_INSIDE = 0.9999  # of a sampled pixel; with less it shows nothing


@dataclass(frozen=True)
class Architecture(VideoArchitecture):
    """Sizes of the networks; stored with the weights. `latent_size` is of each branch.

    `form` "generic" has the networks for square images; "kitti" and "cityscapes" have those for
    92x310 and 128x256 pixels, of whose sizes only `coding.code_size` may be changed (the README has
    64, with a latent size of 32). Other defaults are those of args.py and of the README for BAIR.
    """

    hidden_size: int = 256
    predictor_layers: int = 2
    latent_layers: int = 1
    latent_size: int = 64
    mask_width: int = 64
    form: Literal["generic", "kitti", "cityscapes"] = "generic"

    @property
    def size_px(self) -> tuple[int, int]:
        """Return height and width of the images."""
        return super().size_px if self.form == "generic" else SIZES_PX[self.form][0]


class Blend(NamedTuple):
    """Images [..., C, H, W] of each branch and blended."""

    images: Tensor
    appearance: Tensor
    motion: Tensor  # the previous frames, warped


class Output(NamedTuple):
    """Predictions of all steps but the first, and posterior and prior of the latents of both
    branches.
    """

    prediction: Blend  # [B, T - 1, ...]
    latents: list[tuple[Normal, Normal]]


class Look(NamedTuple):
    """What the encoders see in a frame."""

    frame: Tensor
    seen: Tensor  # input of the motion encoder: the frame, or shared features of it
    code: Tensor
    skips: list[Tensor]


class SlampNetwork(VideoNetwork):
    """The appearance branch sees frames, the motion branch pairs of consecutive frames."""

    def __init__(self, architecture: Architecture) -> None:
        coding, form, latent = architecture.coding, architecture.form, architecture.latent_size
        grid = () if form == "generic" else SIZES_PX[form][-1]
        super().__init__(2 * latent * math.prod(grid))
        self.latent_shape = (latent, *grid)
        code, colours, hidden = coding.code_size, coding.colours, architecture.hidden_size
        self.img_encoder: nn.Module | None = None
        if form == "generic":
            self.pixel_encoder: nn.Module = Encoder(coding, colours, "slamp")
            self.motion_encoder: nn.Module = Encoder(coding, 2 * colours, "slamp")
            self.pixel_decoder: nn.Module = Decoder(coding, colours, "slamp", nn.Sigmoid())
            self.flow_decoder: nn.Module = Decoder(coding, 2, "slamp", nn.Identity())
        else:
            self.img_encoder = ImageEncoder(form, colours, 2 * code)
            self.pixel_encoder = SpatialEncoder(2 * code, code)
            self.motion_encoder = SpatialEncoder(4 * code, code)
            self.pixel_decoder = GridDecoder(form, code, colours, nn.Sigmoid())
            self.flow_decoder = GridDecoder(form, code, 2, nn.Identity())
        self.mask_decoder = MaskNetwork(2 * colours, architecture.mask_width)
        initialise(self)
        is_grid, layers = form != "generic", architecture.latent_layers
        for name in ("static_frame_predictor", "dynamic_frame_predictor"):
            depth = architecture.predictor_layers
            network: nn.Module = LstmPredictor(code + latent, code, hidden, depth, is_grid=is_grid)
            self.add_module(name, network)
        for name in ("posterior_app", "prior_app", "posterior_motion", "prior_motion"):
            self.add_module(name, GaussianLstm(code, latent, hidden, layers, is_grid=is_grid))

    def look(self, frame: Tensor) -> Look:
        """Encode frames [B, C, H, W]."""
        if self.img_encoder is None:
            return Look(frame, frame, *self.pixel_encoder(frame))
        seen, skips = self.img_encoder(frame)
        return Look(frame, seen, self.pixel_encoder(seen), skips)

    def motion(self, before: Look, after: Look) -> Tensor:
        """Encode the motion between two frames; its skips are not used."""
        encoded = self.motion_encoder(torch.cat([before.seen, after.seen], dim=1))
        return encoded[0] if self.img_encoder is None else encoded

    def forward(self, images: Tensor, num_past: int, real_probability: float = 1.0) -> Output:
        """Predict each frame of [B, T, C, H, W] from those before it.

        The future is fed back instead of the real frame, unless a draw of `real_probability` says
        otherwise (scheduled sampling).
        """
        rollout, predicted = Rollout(self, images[:, 0]), []
        latents: list[tuple[Normal, Normal]] = []
        for step in range(1, images.shape[1]):
            after = self.look(images[:, step])
            motion = self.motion(rollout.now, after)
            posteriors = rollout.posteriors(after, motion)
            latents += zip(posteriors, rollout.priors(), strict=True)
            codes = rollout.predict([posterior.rsample() for posterior in posteriors])
            blend = rollout.decode(codes)
            predicted.append(blend)
            is_real = step < num_past or float(torch.rand(())) < real_probability
            rollout.go_on(after if is_real else self.look(blend.images.detach()), motion)
        stacked = (torch.stack(each, dim=1) for each in zip(*predicted, strict=True))
        return Output(Blend(*stacked), latents)

    def predict(self, observed: Tensor, noise: Tensor) -> Tensor:
        """Predict futures [N, F, C, H, W], each frame from those predicted before it."""
        rollout, num_past, frames = Rollout(self, observed[:, 0]), observed.shape[1], []
        for step in range(1, noise.shape[1]):
            halves = noise[:, step].chunk(2, dim=1)
            pair = [half.unflatten(1, self.latent_shape) for half in halves]
            distributions = rollout.priors()
            if step < num_past:
                after = self.look(observed[:, step])
                motion = self.motion(rollout.now, after)
                distributions = rollout.posteriors(after, motion)
            codes = rollout.predict(
                [drawn(*both) for both in zip(distributions, pair, strict=True)]
            )
            if step >= num_past:
                frames.append(rollout.decode(codes).images)
                after = self.look(frames[-1])
                motion = self.motion(rollout.now, after)
            rollout.go_on(after, motion)
        return torch.stack(frames, dim=1)


class Rollout:
    """Both branches at one frame."""

    def __init__(self, network: Any, first: Tensor) -> None:
        """Start at frames [B, C, H, W], before which nothing moved."""
        self.network, self.memory, self.num_frames = network, Memory(), 1
        self.now = network.look(first)
        self.motion, self.skips = network.motion(self.now, self.now), self.now.skips

    def priors(self) -> tuple[Normal, Normal]:
        """Return the priors of appearance and motion, which know this frame."""
        network = self.network
        return (
            self.memory(network.prior_app, self.now.code),
            self.memory(network.prior_motion, self.motion),
        )

    def posteriors(self, after: Look, motion: Tensor) -> tuple[Normal, Normal]:
        """Return the posteriors, which know the next frame and the motion to it."""
        network = self.network
        return (
            self.memory(network.posterior_app, after.code),
            self.memory(network.posterior_motion, motion),
        )

    def predict(self, latents: list[Tensor]) -> list[Tensor]:
        """Predict the codes of the next frame, and of the motion to it."""
        network = self.network
        predictors = (network.static_frame_predictor, network.dynamic_frame_predictor)
        branches = zip(predictors, (self.now.code, self.motion), latents, strict=True)
        return [
            self.memory(predictor, torch.cat([code, latent], dim=1))
            for predictor, code, latent in branches
        ]

    def decode(self, codes: list[Tensor]) -> Blend:
        """Decode codes to the next frame; both decoders get the appearance encoder's skips."""
        network = self.network
        appearance = network.pixel_decoder(codes[0], self.skips)
        flow_px = network.flow_decoder(codes[1], self.skips)
        motion = warp(self.now.frame, flow_px).clamp(0, 1)
        mask = network.mask_decoder(torch.cat([appearance, motion], dim=1))
        return Blend(mask * appearance + (1 - mask) * motion, appearance, motion)

    def go_on(self, after: Look, motion: Tensor) -> None:
        """Go on to the next frame; skips are running averages over all frames."""
        self.now, self.motion = after, motion
        self.num_frames += 1
        self.skips = [
            mean + (new - mean) / self.num_frames
            for mean, new in zip(self.skips, after.skips, strict=True)
        ]


@dataclass(frozen=True)
class SlampTraining(VideoTraining):
    """Training of SLAMP; the three mean squared errors count alike.

    With `sampling_constant` k the real frame is fed back with the probability k / (k + exp(e / k))
    after e epochs of `epoch_steps`, and always with 0 (train.py, --sch_sampling).
    """

    architecture: Architecture = field(default_factory=Architecture)
    beta: float = 1e-4  # of both branches' KL divergence
    sampling_constant: float = 0.0
    epoch_steps: int = 1000

    network = SlampNetwork

    def losses(self, network: nn.Module, images: Tensor, step: int = 0) -> Losses:
        """Return sums over predicted frames of mean squared errors and of nats per clip."""
        probability, k = 1.0, self.sampling_constant
        if k:
            probability = k / (k + math.exp(min(step // self.epoch_steps / k, 700.0)))
        output: Output = network(images, self.num_past, probability)
        error, appearance, motion = (
            functional.mse_loss(shown, images[:, 1:]) * shown.shape[1]
            for shown in output.prediction
        )
        nats = summed_nats(output.latents)
        return {
            "total": error + appearance + motion + self.beta * nats,
            "error": error,
            "appearance": appearance,
            "motion": motion,
            "nats": nats,
        }


def warp(images: Tensor, flow_px: Tensor) -> Tensor:
    """Warp backwards: each pixel of [N, C, H, W] shows what lies `flow_px` [N, 2, H, W] (right,
    down) from it, and 0 where that is outside.
    """
    last_px = flow_px.new_tensor([images.shape[3] - 1, images.shape[2] - 1])
    positions = pixel_grid(images.shape[2:], flow_px) + flow_px.movedim(1, -1)
    grid = 2 * positions / last_px - 1
    sampled = functional.grid_sample(images, grid, align_corners=True)
    inside = functional.grid_sample(torch.ones_like(images[:, :1]), grid, align_corners=True)
    return sampled * (inside >= MIN_INSIDE)
