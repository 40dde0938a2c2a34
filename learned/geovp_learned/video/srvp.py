"""SRVP: stochastic latent residual video prediction (Franceschi et al. 2020)."""

from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor, nn

from geovp_learned import methods
from geovp_learned.methods import Losses
from geovp_learned.video.autoencoder import (
    AutoencoderConfig,
    Decoder,
    Encoder,
    last_skips,
    select_skips,
)
from geovp_learned.video.latents import Gaussian, Lstm, kl_divergence
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

    def __post_init__(self) -> None:
        methods.check_counts(self, "hidden_layers", "first_frames", "steps_per_frame")


class Output(NamedTuple):
    """All frames reconstructed from their states, and the distributions that the states were drawn
    from.
    """

    images: Tensor  # [B, T, 3, H, W]
    first: Gaussian  # [B, state_size]; its prior is the standard normal
    posterior: Gaussian  # [B, T - 1, latent_size]
    prior: Gaussian
    residuals: Tensor  # [B, T - 1, steps_per_frame, state_size]


class SrvpNetwork(VideoNetwork):
    """States y and content w (section 3); a frame is decoded from its state, so no predicted frame
    is fed back.
    """

    def __init__(self, architecture: Architecture) -> None:
        coding, state, latent = (
            architecture.coding,
            architecture.state_size,
            architecture.latent_size,
        )
        super().__init__(coding, latent)
        self.first_frames, self.steps_per_frame = (
            architecture.first_frames,
            architecture.steps_per_frame,
        )
        content, hidden, layers = (
            architecture.content_size,
            architecture.hidden_size,
            architecture.hidden_layers,
        )
        self.encoder = Encoder(coding)
        self.decoder = Decoder(coding, code_size=state + content)
        self.summand = _perceptron([coding.code_size, hidden, content])
        self.content = _perceptron([content, hidden, content])
        self.first = _perceptron(
            [self.first_frames * coding.code_size, *[hidden] * (layers - 1), 2 * state]
        )
        self.posterior = Lstm(coding.code_size, hidden, 1, 2 * latent)
        self.prior = _perceptron([state, *[hidden] * (layers - 1), 2 * latent])
        self.residual = _perceptron([state + latent, *[hidden] * (layers - 1), state])

    def forward(self, images: Tensor, num_past: int) -> Output:
        """Reconstruct all frames [B, T, 3, H, W], with inferred latents and the content of the
        observed ones.
        """
        batch, steps = images.shape[:2]
        codes, skips, first, posterior = self._infer(images, num_past)
        states, residuals = [first.sample()], []
        for latent in posterior.sample().unbind(1):
            state, residual = self.next_state(states[-1], latent)
            states.append(state)
            residuals.append(residual)
        stacked = torch.stack(states, dim=1)
        prior = Gaussian.from_output(self.prior(stacked[:, :-1]))
        last = torch.full((steps,), num_past - 1, device=images.device)
        base = images[:, last].flatten(0, 1)
        decoded = self._decode(
            stacked, self._content(codes[:, :num_past]), select_skips(skips, batch, last), base
        )
        return Output(
            decoded.unflatten(0, (batch, steps)),
            first,
            posterior,
            prior,
            torch.stack(residuals, dim=1),
        )

    def predict(self, observed: Tensor, noise: Tensor) -> Tensor:
        """Predict futures [N, F, 3, H, W], their latents drawn from the prior."""
        codes, skips, first, posterior = self._infer(observed, observed.shape[1])
        state = first.mean
        for latent in posterior.mean.unbind(1):
            state, _ = self.next_state(state, latent)
        rows = len(noise)
        content, skips = (
            self._content(codes).expand(rows, -1),
            last_skips(skips, len(observed), rows),
        )
        state, base = state.expand(rows, -1), observed[:, -1].expand(rows, -1, -1, -1)
        predicted = []
        for step_noise in noise.unbind(dim=1):
            latent = Gaussian.from_output(self.prior(state)).sample(step_noise)
            state, _ = self.next_state(state, latent)
            predicted.append(self._decode(state[:, None], content, skips, base))
        return torch.stack(predicted, dim=1)

    def next_state(self, state: Tensor, latent: Tensor) -> tuple[Tensor, Tensor]:
        """Return the state [B, Y] one frame later by Euler steps, and the residuals [B,
        steps_per_frame, Y].
        """
        residuals = []
        for _ in range(self.steps_per_frame):
            residuals.append(
                1 / self.steps_per_frame * self.residual(torch.cat([state, latent], dim=-1))
            )
            state = state + residuals[-1]
        return state, torch.stack(residuals, dim=1)

    def _infer(
        self, images: Tensor, num_past: int
    ) -> tuple[Tensor, list[Tensor], Gaussian, Gaussian]:
        """Infer codes [B, T, code_size], skips [B * T, ...], the first state and the latents [B, T
        - 1, latent_size].

        The first state is inferred from the first observed frames; the last is repeated where there
        are too few.
        """
        flat, skips = self.encoder(images.flatten(0, 1))
        codes = flat.unflatten(0, images.shape[:2])
        first_steps = torch.arange(self.first_frames, device=codes.device).clamp(max=num_past - 1)
        first = Gaussian.from_output(self.first(codes[:, first_steps].flatten(1)))
        return codes, skips, first, Gaussian.from_output(self.posterior(codes)[0][:, 1:])

    def _content(self, codes: Tensor) -> Tensor:
        """Return the content [B, W] of observed frames [B, P, code_size], in any order."""
        return torch.tanh(self.content(self.summand(codes).mean(dim=1)))

    def _decode(self, states: Tensor, content: Tensor, skips: list[Tensor], base: Tensor) -> Tensor:
        """Decode states [B, T, Y] to images [B * T, 3, H, W]."""
        codes = torch.cat(
            [states, content[:, None].expand(-1, states.shape[1], -1)], dim=-1
        ).flatten(0, 1)
        return self.images(self.decoder(codes, skips), base)


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
        error = (
            0.5
            * ((output.images - images) / self.observation_std).square().sum((1, 2, 3, 4)).mean()
        )
        standard = Gaussian(
            *(torch.zeros_like(part) for part in output.first)
        )  # mean 0 and variance 1
        first = kl_divergence(output.first, standard).mean()
        nats = kl_divergence(output.posterior, output.prior).sum(1).mean()
        residual = output.residuals.norm(dim=-1).sum((1, 2)).mean()
        total = error + self.beta_first * first + self.beta * nats + self.residual_weight * residual
        parts = {
            "total": total,
            "error": error,
            "first_nats": first,
            "nats": nats,
            "residual": residual,
        }
        return {name: part / images[0].numel() for name, part in parts.items()}


def _perceptron(sizes: list[int]) -> nn.Sequential:
    """Build linear layers with ReLU between them."""
    layers: list[nn.Module] = []
    for n in range(len(sizes) - 1):
        layers += [nn.Linear(sizes[n], sizes[n + 1]), nn.ReLU()]
    return nn.Sequential(*layers[:-1])
