"""SLAMP's networks: one branch draws the next frame, one moves the last frame, a mask chooses (Akan et al. 2021).

The mask comes from three plain convolutions over both images; the authors' (github.com/kaanakan/slamp,
models/mask_predictor.py) has five with batch normalisation and squeeze-and-excitation.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor, nn

from learned.slamp.warping import warped
from learned.video.coders import Coding, Decoder, Encoder, Skips, images_from_maps, picked, repeated
from learned.video.latents import Gaussian, Memory, RecurrentMap, many


@dataclass(frozen=True)
class Architecture:
    """What the networks are built from; stored with the weights.

    The published motion decoder gives the flow in units of its own; here one unit is `flow_unit_px`.
    """

    coding: Coding = field(default_factory=Coding)
    hidden_size: int = 256
    predictor_layers: int = 2
    latent_layers: int = 1
    latent_size: int = 64  # of each branch
    mask_width: int = 32
    flow_unit_px: float = 1.0


class Branch(nn.Module):
    """An encoder, latents with a learned prior, and a decoder: what SVG is as a whole."""

    def __init__(self, architecture: Architecture, in_channels: int, out_channels: int) -> None:
        """For inputs and outputs with so many channels."""
        super().__init__()
        coding, hidden, latent = architecture.coding, architecture.hidden_size, architecture.latent_size
        self.encoder, self.decoder = Encoder(coding, in_channels), Decoder(coding, out_channels)
        self.posterior = RecurrentMap(coding.code_size, hidden, architecture.latent_layers, 2 * latent)
        self.prior = RecurrentMap(coding.code_size, hidden, architecture.latent_layers, 2 * latent)
        self.predictor = RecurrentMap(
            coding.code_size + latent, hidden, architecture.predictor_layers, coding.code_size
        )

    def encode(self, inputs: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Codes [B, T, code_size] and skips [B * T, ...] of inputs [B, T, C, H, W]."""
        flat, skips = self.encoder(inputs.flatten(0, 1))
        return flat.unflatten(0, inputs.shape[:2]), skips

    def ahead(self, codes: Tensor, latents: Tensor) -> tuple[Tensor, Memory]:
        """Codes of the next steps from codes and latents [B, T, ...], and the memory after the last."""
        numbers, memory = self.predictor(torch.cat([codes, latents], dim=-1))
        return torch.tanh(numbers), memory


class Shown(NamedTuple):
    """What the branches say of frames, and both together; images [B, T, 3, H, W]."""

    images: Tensor
    appearance: Tensor
    motion: Tensor  # the frames before, moved
    masks: Tensor  # [B, T, 1, H, W]: share of the appearance
    flow_px: Tensor  # [B, T, 2, H, W]


class Learned(NamedTuple):
    """What training compares, of all steps but the first."""

    shown: Shown
    posteriors: tuple[Gaussian, Gaussian]  # of appearance and motion, [B, T - 1, latent_size]
    priors: tuple[Gaussian, Gaussian]


class SlampNetwork(nn.Module):
    """The appearance branch sees frames, the motion branch pairs of them: each frame beside the one before it."""

    def __init__(self, architecture: Architecture) -> None:
        """Fresh networks; a residual coding starts with no flow."""
        super().__init__()
        self.architecture, width = architecture, architecture.mask_width
        self.appearance, self.motion = Branch(architecture, 3, 3), Branch(architecture, 6, 2)
        self.mask = nn.Sequential(
            nn.Conv2d(6, width, 3, padding=1), nn.LeakyReLU(0.2),
            nn.Conv2d(width, width, 3, padding=1), nn.LeakyReLU(0.2), nn.Conv2d(width, 1, 3, padding=1),
        )  # fmt: skip

    @property
    def size_px(self) -> int:
        """The side of its square images."""
        return self.architecture.coding.size_px

    @property
    def noise_size(self) -> int:
        """One normal number for every latent of both branches."""
        return 2 * self.architecture.latent_size

    def forward(self, images: Tensor, num_past: int) -> Learned:
        """Predictions from the real frames [B, T, 3, H, W] before each; skips come from observed frames at most."""
        batch, steps = images.shape[:2]
        seen = torch.arange(steps - 1, device=images.device).clamp(max=num_past - 1)
        posteriors, priors, maps = [], [], []
        for branch, inputs in self._branches(images):
            codes, skips = branch.encode(inputs)
            posteriors.append(Gaussian.halves(branch.posterior(codes[:, 1:])[0]))
            priors.append(Gaussian.halves(branch.prior(codes[:, :-1])[0]))
            ahead, _ = branch.ahead(codes[:, :-1], posteriors[-1].draw())
            maps.append(branch.decoder(ahead.flatten(0, 1), picked(skips, batch, seen)))
        bases, before = images[:, seen].flatten(0, 1), images[:, :-1].flatten(0, 1)
        shown = self._shown(maps[0], maps[1], bases, before)
        shown = Shown(*(part.unflatten(0, (batch, steps - 1)) for part in shown))
        return Learned(shown, (posteriors[0], posteriors[1]), (priors[0], priors[1]))

    def predict(self, observed: Tensor, noise: Tensor) -> Tensor:
        """Futures [N, F, 3, H, W] by drawing from both priors, each frame from those predicted before it."""
        rows, made = len(noise), [observed[:, n].expand(len(noise), -1, -1, -1) for n in (-2, -1)]
        futures = [_Future(branch, inputs, rows) for branch, inputs in self._branches(observed)]
        base = made[-1]
        for step in range(noise.shape[1]):
            if step > 0:
                futures[0].see(made[-1])
                futures[1].see(torch.cat(made[-2:], dim=1))
            draws = noise[:, step].chunk(2, dim=-1)
            maps = [future.maps(draw) for future, draw in zip(futures, draws, strict=True)]
            made.append(self._shown(maps[0], maps[1], base, made[-1]).images)
        return torch.stack(made[2:], dim=1)

    def _branches(self, images: Tensor) -> tuple[tuple[Branch, Tensor], tuple[Branch, Tensor]]:
        """Each branch with its inputs [B, T, C, H, W]; before the first frame nothing moved."""
        before = torch.cat([images[:, :1], images[:, :-1]], dim=1)
        return (self.appearance, images), (self.motion, torch.cat([before, images], dim=2))

    def _shown(self, maps: Tensor, flow: Tensor, base: Tensor, before: Tensor) -> Shown:
        """Images [N, 3, H, W] of decoded maps; `before` are the frames that flow starts from."""
        appearance = images_from_maps(maps, base if self.architecture.coding.residual else None)
        flow_px = flow * self.architecture.flow_unit_px
        motion = warped(before, flow_px)
        masks = torch.sigmoid(self.mask(torch.cat([appearance, motion], dim=1)))
        return Shown(masks * appearance + (1 - masks) * motion, appearance, motion, masks, flow_px)


class _Future:
    """Where one branch stands while frames are predicted."""

    def __init__(self, branch: Branch, observed: Tensor, rows: int) -> None:
        """After the observed inputs [B, P, C, H, W], so many times over."""
        self.branch = branch
        codes, skips = branch.encode(observed)
        explained = Gaussian.halves(branch.posterior(codes[:, 1:])[0]).mean
        self.prior_memory = many(branch.prior(codes[:, :-1])[1], rows)
        self.memory = many(branch.ahead(codes[:, :-1], explained)[1], rows)
        last = torch.tensor([codes.shape[1] - 1], device=codes.device)
        self.skips: Skips = repeated(picked(skips, len(codes), last), rows)
        self.code = codes[:, -1].expand(rows, -1)

    def maps(self, noise: Tensor) -> Tensor:
        """One step on, from the input seen last."""
        numbers, self.prior_memory = self.branch.prior.step(self.code, self.prior_memory)
        latent = Gaussian.halves(numbers).at(noise)
        ahead, self.memory = self.branch.predictor.step(torch.cat([self.code, latent], dim=-1), self.memory)
        maps: Tensor = self.branch.decoder(torch.tanh(ahead), self.skips)
        return maps

    def see(self, inputs: Tensor) -> None:
        """The next input [N, C, H, W]."""
        self.code, _ = self.branch.encoder(inputs)
