"""SVG-LP: stochastic video generation with a learned prior (Denton and Fergus 2018).

Networks, loss and generation are those of the authors' repository (edenton/svg: models/,
train_svg_lp.py, generate_svg_lp.py), and so are the names of the modules. One thing differs: the
authors normalise by the statistics of a batch of test clips, we by those of training, since a
prediction must not depend on other clips.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.distributions import Normal
from torch.nn import functional

from geovp_learned.methods import Losses
from geovp_learned.video.autoencoder import Decoder, Encoder, initialise
from geovp_learned.video.latents import GaussianLstm, LstmPredictor, Memory, drawn, summed_nats
from geovp_learned.video.training import VideoArchitecture, VideoNetwork, VideoTraining


@dataclass(frozen=True)
class Architecture(VideoArchitecture):
    """Sizes of the networks; stored with the weights. Defaults of train_svg_lp.py; z of BAIR."""

    hidden_size: int = 256
    predictor_layers: int = 2
    latent_layers: int = 1
    latent_size: int = 64
    last_frame_skip: bool = False  # skips of the last frame, not of one among the observed


class Output(NamedTuple):
    """Predictions of all steps but the first, and the distributions of their latents."""

    images: Tensor  # [B, T - 1, C, H, W]
    latents: list[tuple[Normal, Normal]]  # posterior and prior [B, latent_size] of each step


class SvgNetwork(VideoNetwork):
    """The next frame is decoded from the code of the current one and a latent.

    The posterior of the latent knows the next frame; the prior does not.
    """

    def __init__(self, architecture: Architecture) -> None:
        coding, hidden = architecture.coding, architecture.hidden_size
        code, latent, layers = (
            coding.code_size,
            architecture.latent_size,
            architecture.latent_layers,
        )
        super().__init__(latent)
        self.last_frame_skip = architecture.last_frame_skip
        self.encoder = Encoder(coding, coding.colours, "svg")
        self.decoder = Decoder(coding, coding.colours, "svg", nn.Sigmoid())
        self.frame_predictor = LstmPredictor(
            code + latent, code, hidden, architecture.predictor_layers
        )
        self.posterior = GaussianLstm(code, latent, hidden, layers)
        self.prior = GaussianLstm(code, latent, hidden, layers)
        initialise(self)

    def forward(self, images: Tensor, num_past: int) -> Output:
        """Predict each frame of [B, T, C, H, W] from the real ones before it.

        Batch normalisation sees the frames of one time step at a time.
        """
        encoded = [self.encoder(frame) for frame in images.unbind(1)]
        memory, predicted, latents = Memory(), [], []
        for step in range(1, len(encoded)):
            code = encoded[step - 1][0]
            if step < num_past or self.last_frame_skip:
                skips = encoded[step - 1][1]
            posterior = memory(self.posterior, encoded[step][0])
            latents.append((posterior, memory(self.prior, code)))
            inputs = torch.cat([code, posterior.rsample()], dim=1)
            predicted.append(self.decoder(memory(self.frame_predictor, inputs), skips))
        return Output(torch.stack(predicted, dim=1), latents)

    def predict(self, observed: Tensor, noise: Tensor) -> Tensor:
        """Predict futures [N, F, C, H, W]; latents of observed frames are drawn, too."""
        memory, frames, num_past = Memory(), list(observed.unbind(1)), observed.shape[1]
        for step in range(1, noise.shape[1]):
            is_observed = step < num_past
            code, new_skips = self.encoder(frames[step - 1])
            if is_observed or self.last_frame_skip:
                skips = new_skips
            latent = memory(self.prior, code)
            if is_observed:
                latent = memory(self.posterior, self.encoder(frames[step])[0])
            inputs = torch.cat([code, drawn(latent, noise[:, step])], dim=1)
            predicted = memory(self.frame_predictor, inputs)
            if not is_observed:
                frames.append(self.decoder(predicted, skips))
        return torch.stack(frames[num_past:], dim=1)


@dataclass(frozen=True)
class SvgTraining(VideoTraining):
    """Training of SVG-LP; `beta` weighs the KL divergence against the mean squared error."""

    architecture: Architecture = field(default_factory=Architecture)
    beta: float = 1e-4

    network = SvgNetwork

    def losses(self, network: nn.Module, images: Tensor, step: int = 0) -> Losses:
        """Return the sums over predicted frames of mean squared errors and of nats per clip."""
        output: Output = network(images, self.num_past)
        error = functional.mse_loss(output.images, images[:, 1:]) * output.images.shape[1]
        nats = summed_nats(output.latents)
        return {"total": error + self.beta * nats, "error": error, "nats": nats}
