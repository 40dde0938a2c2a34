"""SVG-LP's networks: a recurrent frame predictor and two distributions (Denton and Fergus 2018, section 3)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor, nn

from learned.video.coders import Coding, Decoder, Encoder, images_from_maps, picked, repeated
from learned.video.latents import Gaussian, RecurrentMap, many


@dataclass(frozen=True)
class Architecture:
    """What the networks are built from; stored with the weights. Defaults as in the paper."""

    coding: Coding = field(default_factory=Coding)
    hidden_size: int = 256
    predictor_layers: int = 2
    latent_layers: int = 1
    latent_size: int = 64


class Learned(NamedTuple):
    """What training compares: predictions of all steps but the first, and who explained them."""

    images: Tensor  # [B, T - 1, 3, H, W]
    posterior: Gaussian  # [B, T - 1, latent_size]
    prior: Gaussian


class SvgNetwork(nn.Module):
    """The next frame from the code of this one and a latent; the posterior saw the next frame, the prior did not."""

    def __init__(self, architecture: Architecture) -> None:
        """Fresh networks."""
        super().__init__()
        self.architecture, coding = architecture, architecture.coding
        hidden, latent = architecture.hidden_size, architecture.latent_size
        self.encoder, self.decoder = Encoder(coding), Decoder(coding)
        self.posterior = RecurrentMap(coding.code_size, hidden, architecture.latent_layers, 2 * latent)
        self.prior = RecurrentMap(coding.code_size, hidden, architecture.latent_layers, 2 * latent)
        self.predictor = RecurrentMap(
            coding.code_size + latent, hidden, architecture.predictor_layers, coding.code_size
        )

    @property
    def size_px(self) -> int:
        """The side of its square images."""
        return self.architecture.coding.size_px

    @property
    def noise_size(self) -> int:
        """One normal number for every latent."""
        return self.architecture.latent_size

    def forward(self, images: Tensor, num_past: int) -> Learned:
        """Predictions from the real frames [B, T, 3, H, W] before each; skips come from an observed frame at most."""
        batch, steps = images.shape[:2]
        flat, skips = self.encoder(images.flatten(0, 1))
        codes = flat.unflatten(0, (batch, steps))
        posterior = Gaussian.halves(self.posterior(codes[:, 1:])[0])
        prior = Gaussian.halves(self.prior(codes[:, :-1])[0])
        ahead = torch.tanh(self.predictor(torch.cat([codes[:, :-1], posterior.draw()], dim=-1))[0])
        seen = torch.arange(steps - 1, device=images.device).clamp(max=num_past - 1)
        made = self._shown(ahead.flatten(0, 1), picked(skips, batch, seen), images[:, seen].flatten(0, 1))
        return Learned(made.unflatten(0, (batch, steps - 1)), posterior, prior)

    def predict(self, observed: Tensor, noise: Tensor) -> Tensor:
        """Futures [N, F, 3, H, W] by drawing from the prior, each frame from the one predicted before it."""
        batch, steps = observed.shape[:2]
        flat, skips = self.encoder(observed.flatten(0, 1))
        codes = flat.unflatten(0, (batch, steps))
        explained = Gaussian.halves(self.posterior(codes[:, 1:])[0]).mean
        rows, last = len(noise), torch.tensor([steps - 1], device=observed.device)
        prior_memory = many(self.prior(codes[:, :-1])[1], rows)
        memory = many(self.predictor(torch.cat([codes[:, :-1], explained], dim=-1))[1], rows)
        skips, base = repeated(picked(skips, batch, last), rows), observed[:, -1].expand(rows, -1, -1, -1)
        code, made = codes[:, -1].expand(rows, -1), []
        for step in range(noise.shape[1]):
            numbers, prior_memory = self.prior.step(code, prior_memory)
            latent = Gaussian.halves(numbers).at(noise[:, step])
            ahead, memory = self.predictor.step(torch.cat([code, latent], dim=-1), memory)
            made.append(self._shown(torch.tanh(ahead), skips, base))
            code, _ = self.encoder(made[-1])
        return torch.stack(made, dim=1)

    def _shown(self, codes: Tensor, skips: list[Tensor], base: Tensor) -> Tensor:
        return images_from_maps(self.decoder(codes, skips), base if self.architecture.coding.residual else None)
