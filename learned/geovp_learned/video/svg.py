"""SVG-LP: stochastic video generation with a learned prior (Denton and Fergus 2018)."""

from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.distributions import Normal, kl_divergence
from torch.nn import functional

from geovp_learned.methods import Losses
from geovp_learned.video.autoencoder import AutoencoderConfig, Decoder, Encoder, select_skips
from geovp_learned.video.latents import Lstm, normal
from geovp_learned.video.training import VideoNetwork, VideoTraining


@dataclass(frozen=True)
class Architecture:
    """Sizes of the networks; stored with the weights. Defaults as in the paper."""

    coding: AutoencoderConfig = field(default_factory=AutoencoderConfig)
    hidden_size: int = 256
    predictor_layers: int = 2
    latent_layers: int = 1
    latent_size: int = 64


class Output(NamedTuple):
    """Predictions of all steps but the first, and the distributions of their latents."""

    images: Tensor  # [B, T - 1, 3, H, W]
    posterior: Normal  # [B, T - 1, latent_size]
    prior: Normal


class RecurrentAutoencoder(VideoNetwork):
    """The encoder, the LSTMs of posterior, prior and predictor, and the decoder.

    The next output is decoded from the code of the current input and a latent. The posterior of the
    latent knows the next input; the prior does not.
    """

    def __init__(
        self, architecture: Architecture, in_channels: int = 3, out_channels: int = 3
    ) -> None:
        coding, hidden = architecture.coding, architecture.hidden_size
        latent, layers = architecture.latent_size, architecture.latent_layers
        super().__init__(coding, latent)
        code = coding.code_size
        self.encoder, self.decoder = Encoder(coding, in_channels), Decoder(coding, out_channels)
        self.posterior = Lstm(code, hidden, layers, 2 * latent)
        self.prior = Lstm(code, hidden, layers, 2 * latent)
        self.predictor = Lstm(code + latent, hidden, architecture.predictor_layers, code)

    def encode(self, inputs: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Encode inputs [B, T, C, H, W] as codes [B, T, code_size] and skips [B * T, ...]."""
        flat, skips = self.encoder(inputs.flatten(0, 1))
        return flat.unflatten(0, inputs.shape[:2]), skips

    def teacher_forced(
        self, inputs: Tensor, skip_steps: Tensor
    ) -> tuple[Tensor, tuple[Normal, Normal]]:
        """Return decoded maps [B * (T - 1), C, H, W], and posterior and prior, each step predicted
        from the real input before it.

        The decoder takes the skips of the inputs at `skip_steps` [T - 1].
        """
        codes, skips = self.encode(inputs)
        posterior = normal(self.posterior(codes[:, 1:])[0])
        prior = normal(self.prior(codes[:, :-1])[0])
        predicted, _ = self.predictor(torch.cat([codes[:, :-1], posterior.rsample()], dim=-1))
        skips = select_skips(skips, len(inputs), skip_steps)
        return self.decoder(torch.tanh(predicted).flatten(0, 1), skips), (posterior, prior)


class Rollout:
    """Prediction step by step; the skips stay those of the last observed input."""

    def __init__(self, network: RecurrentAutoencoder, observed: Tensor) -> None:
        """Start after observed inputs [N, P, C, H, W]."""
        self.network = network
        codes, skips = network.encode(observed)
        latents = normal(network.posterior(codes[:, 1:])[0]).mean
        _, self.prior_state = network.prior(codes[:, :-1])
        _, self.state = network.predictor(torch.cat([codes[:, :-1], latents], dim=-1))
        self.skips = select_skips(skips, len(codes), torch.tensor([-1]))
        self.code = codes[:, -1:]

    def step(self, noise: Tensor) -> Tensor:
        """Decode maps [N, C, H, W] of the next step, its latent drawn from the prior by noise
        [N, 1, latent_size].
        """
        output, self.prior_state = self.network.prior(self.code, self.prior_state)
        prior = normal(output)
        inputs = torch.cat([self.code, prior.mean + prior.stddev * noise], dim=-1)
        codes, self.state = self.network.predictor(inputs, self.state)
        return self.network.decoder(torch.tanh(codes[:, 0]), self.skips)

    def feed_back(self, inputs: Tensor) -> None:
        """Start the next step from predicted inputs [N, C, H, W]."""
        self.code, _ = self.network.encode(inputs[:, None])


class SvgNetwork(RecurrentAutoencoder):
    """The recurrent autoencoder on frames."""

    def forward(self, images: Tensor, num_past: int) -> Output:
        """Predict from the real frames [B, T, 3, H, W] before each; skips are of observed frames
        only.
        """
        skip_steps = torch.arange(images.shape[1] - 1, device=images.device).clamp(max=num_past - 1)
        maps, latents = self.teacher_forced(images, skip_steps)
        predicted = self.images(maps, images[:, skip_steps].flatten(0, 1))
        return Output(predicted.unflatten(0, (len(images), -1)), *latents)

    def predict(self, observed: Tensor, noise: Tensor) -> Tensor:
        """Predict futures [N, F, 3, H, W], each frame from the one predicted before it."""
        rollout = Rollout(self, observed)
        predicted: list[Tensor] = []
        for step_noise in noise.split(1, dim=1):
            if predicted:
                rollout.feed_back(predicted[-1])
            predicted.append(self.images(rollout.step(step_noise), observed[:, -1]))
        return torch.stack(predicted, dim=1)


@dataclass(frozen=True)
class SvgTraining(VideoTraining):
    """Training of SVG-LP; `beta` weighs the KL divergence against the mean squared error."""

    architecture: Architecture = field(default_factory=Architecture)
    beta: float = 1e-4

    network = SvgNetwork

    def losses(self, network: nn.Module, images: Tensor) -> Losses:
        """Return means over clips and predicted frames."""
        output: Output = network(images, self.num_past)
        error = functional.mse_loss(output.images, images[:, 1:])
        nats = kl_divergence(output.posterior, output.prior).sum(-1).mean()
        return {"total": error + self.beta * nats, "error": error, "nats": nats}
