"""SRVP's networks: a latent state that moves by residuals, and a content vector (Franceschi et al. 2020, section 3)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor, nn

from geovp_classic.errors import BadData
from learned.video.coders import Coding, Decoder, Encoder, images_from_maps, picked, repeated
from learned.video.latents import Gaussian, RecurrentMap


@dataclass(frozen=True)
class Architecture:
    """What the networks are built from; stored with the weights. Defaults as in the paper."""

    coding: Coding = field(default_factory=Coding)
    hidden_size: int = 256
    hidden_layers: int = 3  # of each small network
    state_size: int = 50
    latent_size: int = 50
    content_size: int = 256
    first_frames: int = 2  # that the first state is inferred from
    steps_per_frame: int = 2  # of Euler's method

    def __post_init__(self) -> None:
        """Raise BadData for counts below one."""
        for name in ("hidden_layers", "first_frames", "steps_per_frame"):
            if getattr(self, name) < 1:
                raise BadData(f"architecture.{name} is {getattr(self, name)}, expected 1 or more")


class Learned(NamedTuple):
    """What training compares: all frames shown from their states, and what the states were drawn from."""

    images: Tensor  # [B, T, 3, H, W]
    first: Gaussian  # [B, state_size], to be near the standard one
    posterior: Gaussian  # [B, T - 1, latent_size]
    prior: Gaussian
    residuals: Tensor  # [B, T - 1, steps_per_frame, state_size]


class SrvpNetwork(nn.Module):
    """States y and content w; a frame is shown from its state alone, so that no predicted frame is ever fed back."""

    def __init__(self, architecture: Architecture) -> None:
        """Fresh networks."""
        super().__init__()
        self.architecture, coding = architecture, architecture.coding
        state, latent, content = architecture.state_size, architecture.latent_size, architecture.content_size
        hidden, layers = architecture.hidden_size, architecture.hidden_layers
        self.encoder = Encoder(coding)
        self.decoder = Decoder(coding, code_size=state + content)
        self.summand = _layers([coding.code_size, hidden, content])
        self.content = _layers([content, hidden, content])
        self.first = _layers([architecture.first_frames * coding.code_size, *[hidden] * (layers - 1), 2 * state])
        self.posterior = RecurrentMap(coding.code_size, hidden, 1, 2 * latent)
        self.prior = _layers([state, *[hidden] * (layers - 1), 2 * latent])
        self.residual = _layers([state + latent, *[hidden] * (layers - 1), state])

    @property
    def size_px(self) -> int:
        """The side of its square images."""
        return self.architecture.coding.size_px

    @property
    def noise_size(self) -> int:
        """One normal number for every latent."""
        return self.architecture.latent_size

    def forward(self, images: Tensor, num_past: int) -> Learned:
        """All frames [B, T, 3, H, W] shown again, with latents inferred from them and content of the observed ones."""
        batch, steps = images.shape[:2]
        flat, skips = self.encoder(images.flatten(0, 1))
        codes = flat.unflatten(0, (batch, steps))
        first = self._first(codes[:, :num_past])
        posterior = Gaussian.halves(self.posterior(codes)[0][:, 1:])
        states, residuals = [first.draw()], []
        for latent in posterior.draw().unbind(1):
            moved, by = self.moved(states[-1], latent)
            states.append(moved)
            residuals.append(by)
        together = torch.stack(states, dim=1)
        prior = Gaussian.halves(self.prior(together[:, :-1]))
        seen = torch.full((steps,), num_past - 1, device=images.device)
        base = images[:, seen].flatten(0, 1)
        made = self._shown(together, self._content(codes[:, :num_past]), picked(skips, batch, seen), base)
        return Learned(made.unflatten(0, (batch, steps)), first, posterior, prior, torch.stack(residuals, dim=1))

    def predict(self, observed: Tensor, noise: Tensor) -> Tensor:
        """Futures [N, F, 3, H, W]: the state goes on by latents drawn from the prior."""
        batch, steps = observed.shape[:2]
        flat, skips = self.encoder(observed.flatten(0, 1))
        codes = flat.unflatten(0, (batch, steps))
        state = self._first(codes).mean
        for latent in Gaussian.halves(self.posterior(codes)[0][:, 1:]).mean.unbind(1):
            state, _ = self.moved(state, latent)
        rows, last = len(noise), torch.tensor([steps - 1], device=observed.device)
        content = self._content(codes).expand(rows, -1)
        state, base = state.expand(rows, -1), observed[:, -1].expand(rows, -1, -1, -1)
        skips, made = repeated(picked(skips, batch, last), rows), []
        for step in range(noise.shape[1]):
            latent = Gaussian.halves(self.prior(state)).at(noise[:, step])
            state, _ = self.moved(state, latent)
            made.append(self._shown(state[:, None], content, skips, base))
        return torch.stack(made, dim=1)

    def moved(self, state: Tensor, latent: Tensor) -> tuple[Tensor, Tensor]:
        """The state [B, Y] one frame later by Euler steps, and what each added [B, steps_per_frame, Y]."""
        share, added = 1 / self.architecture.steps_per_frame, []
        for _ in range(self.architecture.steps_per_frame):
            added.append(share * self.residual(torch.cat([state, latent], dim=-1)))
            state = state + added[-1]
        return state, torch.stack(added, dim=1)

    def _first(self, codes: Tensor) -> Gaussian:
        """The state of the first frame, inferred from the first frames; the last of these again where too few."""
        wanted = torch.arange(self.architecture.first_frames, device=codes.device).clamp(max=codes.shape[1] - 1)
        return Gaussian.halves(self.first(codes[:, wanted].flatten(1)))

    def _content(self, codes: Tensor) -> Tensor:
        """What does not change, of observed frames in any order and number [B, P, code_size]."""
        content: Tensor = torch.tanh(self.content(self.summand(codes).mean(dim=1)))
        return content

    def _shown(self, states: Tensor, content: Tensor, skips: list[Tensor], base: Tensor) -> Tensor:
        """Images [B * T, 3, H, W] of states [B, T, Y]."""
        codes = torch.cat([states, content[:, None].expand(-1, states.shape[1], -1)], dim=-1).flatten(0, 1)
        return images_from_maps(self.decoder(codes, skips), base if self.architecture.coding.residual else None)


def _layers(sizes: list[int]) -> nn.Sequential:
    """Linear layers with ReLU between them."""
    parts: list[nn.Module] = []
    for n in range(len(sizes) - 1):
        parts += [nn.Linear(sizes[n], sizes[n + 1]), nn.ReLU()]
    return nn.Sequential(*parts[:-1])
