"""SRVP: stochastic latent residual video prediction (Franceschi et al. 2020)."""

import itertools
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.distributions import Normal, kl_divergence

from geovp_learned.methods import Losses
from geovp_learned.video.autoencoder import AutoencoderConfig, Decoder, Encoder, select_skips
from geovp_learned.video.latents import Lstm, normal
from geovp_learned.video.training import VideoNetwork, VideoTraining


@dataclass(frozen=True)
class Architecture:
    """Sizes of the networks; stored with the weights. Defaults as in the paper."""

    coding: AutoencoderConfig = field(default_factory=AutoencoderConfig)
    hidden_size: int = 256
    hidden_layers: int = 3  # of each multilayer perceptron
    state_size: int = 50
    latent_size: int = 50
    content_size: int = 256
    first_frames: int = 2  # from which the first state is inferred
    steps_per_frame: int = 2  # of Euler's method


class Output(NamedTuple):
    """All frames reconstructed from their states, and the distributions that the states were drawn
    from.
    """

    images: Tensor  # [B, T, 3, H, W]
    first: Normal  # [B, state_size]; its prior is the standard normal
    posterior: Normal  # [B, T - 1, latent_size]
    prior: Normal
    residuals: Tensor  # [B, T - 1, steps_per_frame, state_size]


class SrvpNetwork(VideoNetwork):
    """States y and content w (section 3); a frame is decoded from its state, so no predicted frame
    is fed back.
    """

    def __init__(self, architecture: Architecture) -> None:
        coding, state = architecture.coding, architecture.state_size
        latent, content = architecture.latent_size, architecture.content_size
        super().__init__(coding, latent)
        self.architecture = architecture
        code, hidden = coding.code_size, architecture.hidden_size
        inner = [hidden] * (architecture.hidden_layers - 1)
        self.encoder = Encoder(coding)
        self.decoder = Decoder(replace(coding, code_size=state + content))
        self.summand = _perceptron([code, hidden, content])
        self.content = _perceptron([content, hidden, content])
        self.first = _perceptron([architecture.first_frames * code, *inner, 2 * state])
        self.posterior = Lstm(code, hidden, 1, 2 * latent)
        self.prior = _perceptron([state, *inner, 2 * latent])
        self.residual = _perceptron([state + latent, *inner, state])

    def forward(self, images: Tensor, num_past: int) -> Output:
        """Reconstruct all frames [B, T, 3, H, W], with inferred latents and the content of the
        observed ones.
        """
        codes, skips, first, posterior = self._infer(images, num_past)
        states, residuals = [first.rsample()], []
        for latent in posterior.rsample().unbind(1):
            state, residual = self.next_state(states[-1], latent)
            states.append(state)
            residuals.append(residual)
        stacked = torch.stack(states, dim=1)
        prior = normal(self.prior(stacked[:, :-1]))
        content = self._content(codes[:, :num_past])
        decoded = self._decode(stacked, content, skips, images[:, num_past - 1])
        return Output(decoded, first, posterior, prior, torch.stack(residuals, dim=1))

    def predict(self, observed: Tensor, noise: Tensor) -> Tensor:
        """Predict futures [N, F, 3, H, W], their latents drawn from the prior."""
        codes, skips, first, posterior = self._infer(observed, observed.shape[1])
        state = first.mean
        for latent in posterior.mean.unbind(1):
            state, _ = self.next_state(state, latent)
        content, frames = self._content(codes), []
        for step_noise in noise.unbind(dim=1):
            prior = normal(self.prior(state))
            state, _ = self.next_state(state, prior.mean + prior.stddev * step_noise)
            frames.append(self._decode(state[:, None], content, skips, observed[:, -1]))
        return torch.cat(frames, dim=1)

    def next_state(self, state: Tensor, latent: Tensor) -> tuple[Tensor, Tensor]:
        """Return the state [B, Y] one frame later by Euler steps, and the residuals [B,
        steps_per_frame, Y].
        """
        residuals, step = [], 1 / self.architecture.steps_per_frame
        for _ in range(self.architecture.steps_per_frame):
            residuals.append(step * self.residual(torch.cat([state, latent], dim=-1)))
            state = state + residuals[-1]
        return state, torch.stack(residuals, dim=1)

    def _infer(self, images: Tensor, num_past: int) -> tuple[Tensor, list[Tensor], Normal, Normal]:
        """Infer codes [B, T, code_size], skips [B, ...] of the last observed frame, the first state
        and the latents [B, T - 1, latent_size].

        The first state is inferred from the first observed frames; the last is repeated where there
        are too few.
        """
        flat, skips = self.encoder(images.flatten(0, 1))
        codes = flat.unflatten(0, images.shape[:2])
        first_steps = torch.arange(self.architecture.first_frames).clamp(max=num_past - 1)
        first = normal(self.first(codes[:, first_steps].flatten(1)))
        skips = select_skips(skips, len(images), torch.tensor([num_past - 1]))
        return codes, skips, first, normal(self.posterior(codes)[0][:, 1:])

    def _content(self, codes: Tensor) -> Tensor:
        """Return the content [B, W] of observed frames [B, P, code_size], in any order."""
        return torch.tanh(self.content(self.summand(codes).mean(dim=1)))

    def _decode(self, states: Tensor, content: Tensor, skips: list[Tensor], base: Tensor) -> Tensor:
        """Decode states [B, T, Y] to images [B, T, 3, H, W], with skips and base of one frame."""
        num_steps = states.shape[1]
        codes = torch.cat([states, content[:, None].expand(-1, num_steps, -1)], dim=-1)
        *skips, base = (maps.repeat_interleave(num_steps, dim=0) for maps in (*skips, base))
        images = self.images(self.decoder(codes.flatten(0, 1), skips), base)
        return images.unflatten(0, (-1, num_steps))


@dataclass(frozen=True)
class SrvpTraining(VideoTraining):
    """Training of SRVP on the evidence lower bound; with all betas 1 it is exact, in nats.

    Residuals are penalised as in the authors' code (github.com/edouardelasalles/srvp, train.py): by
    the sum of their Euclidean lengths over all Euler steps. Losses are divided by the number of
    values of a clip, so that they compare with those of the other methods.
    """

    architecture: Architecture = field(default_factory=Architecture)
    observation_std: float = 1.0  # of a pixel's value around the decoded one
    beta_first: float = 1.0  # weight of the first state's KL divergence
    beta: float = 1.0  # weight of the latents' KL divergence
    residual_weight: float = 1.0

    network = SrvpNetwork

    def losses(self, network: nn.Module, images: Tensor) -> Losses:
        """Return the nats of a clip, divided by the number of its values."""
        output: Output = network(images, self.num_past)
        squares = ((output.images - images) / self.observation_std).square()
        error = 0.5 * squares.sum((1, 2, 3, 4)).mean()
        first = kl_divergence(output.first, Normal(0.0, 1.0)).sum(-1).mean()
        nats = kl_divergence(output.posterior, output.prior).sum((1, 2)).mean()
        residual = output.residuals.norm(dim=-1).sum((1, 2)).mean()
        total = error + self.beta_first * first + self.beta * nats + self.residual_weight * residual
        parts = {
            "total": total,
            "error": error,
            "first_nats": first,
            "nats": nats,
            "residual": residual,
        }
        return {name: loss / images[0].numel() for name, loss in parts.items()}


def _perceptron(sizes: list[int]) -> nn.Sequential:
    """Build linear layers with ReLU between them."""
    layers: list[nn.Module] = []
    for in_size, out_size in itertools.pairwise(sizes):
        layers += [nn.Linear(in_size, out_size), nn.ReLU()]
    return nn.Sequential(*layers[:-1])
