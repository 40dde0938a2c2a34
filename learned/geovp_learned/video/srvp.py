"""SRVP: stochastic latent residual video prediction (Franceschi et al. 2020).

Networks, loss and generation are those of the authors' repository (edouardelasalles/srvp: module/,
train.py, test.py), and so are the names of the modules outside encoder and decoder.
"""

import itertools
from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.distributions import Normal, kl_divergence
from torch.nn import functional

from geovp_learned.methods import Losses
from geovp_learned.video.autoencoder import Decoder, Encoder, initialise
from geovp_learned.video.latents import drawn, summed_nats
from geovp_learned.video.training import VideoArchitecture, VideoNetwork, VideoTraining

MIN_STD = 1e-8


@dataclass(frozen=True)
class Architecture(VideoArchitecture):
    """Sizes of the networks; stored with the weights.

    Defaults of args.py, and of the README's command for KTH and Human3.6M where there are none.
    """

    use_skips: bool = True
    inference_size: int = 256  # hidden units of inference and of the content vector
    inference_layers: int = 3
    residual_size: int = 512  # hidden units of the prior and of the residual
    residual_layers: int = 4
    residual_gain: float = 1.2  # of its orthogonal initialisation
    state_size: int = 50
    latent_size: int = 50
    first_frames: int = 3  # from which the first state and the content are inferred
    steps_per_frame: int = 2  # of Euler's method


class Output(NamedTuple):
    """All frames reconstructed from their states, and the distributions that the states were drawn
    from.
    """

    images: Tensor  # [B, T, C, H, W]
    first: Normal  # [B, state_size]; its prior is the standard normal
    latents: list[tuple[Normal, Normal]]  # posterior and prior [B, latent_size] of each step
    residuals: Tensor  # [B, T - 1, steps_per_frame, state_size]


class Perceptron(nn.Module):
    """Linear layers with ReLU between them."""

    def __init__(self, in_size: int, hidden_size: int, out_size: int, layers: int) -> None:
        super().__init__()
        sizes = [in_size, *[hidden_size] * (layers - 1), out_size]
        linear = [nn.Linear(a, b) for a, b in itertools.pairwise(sizes)]
        first, *others = linear
        blocks = [nn.Sequential(first), *(nn.Sequential(nn.ReLU(), other) for other in others)]
        self.module = nn.Sequential(*blocks)

    def forward(self, numbers: Tensor) -> Tensor:
        """Map numbers [..., in_size] to [..., out_size]."""
        return self.module(numbers)


class SrvpNetwork(VideoNetwork):
    """States y and content w (section 3); a frame is decoded from its state, so no predicted frame
    is fed back.
    """

    def __init__(self, architecture: Architecture) -> None:
        coding, state = architecture.coding, architecture.state_size
        latent, content = architecture.latent_size, architecture.inference_size
        super().__init__(max(state, latent))
        self.architecture = architecture
        code, layers = coding.code_size, architecture.inference_layers
        width, depth = architecture.residual_size, architecture.residual_layers
        self.encoder = Encoder(coding, coding.colours, "srvp")
        self.decoder = Decoder(
            coding,
            coding.colours,
            "srvp",
            nn.Sigmoid(),
            code_size=content + state,
            use_skips=architecture.use_skips,
        )
        self.w_proj = nn.Sequential(nn.Linear(code, content), nn.ReLU())
        self.w_inf = nn.Sequential(nn.Linear(content, content), nn.Tanh())
        self.q_y = Perceptron(code * architecture.first_frames, content, 2 * state, layers)
        self.inf_z = nn.LSTM(code, content, batch_first=True)
        self.q_z = nn.Linear(content, 2 * latent)
        self.p_z = Perceptron(state, width, 2 * latent, depth)
        self.dynamics: nn.Module = Perceptron(state + latent, width, state, depth)
        initialise(self.encoder)
        initialise(self.decoder)
        for parameter in self.dynamics.parameters():
            if parameter.ndim > 1:
                nn.init.orthogonal_(parameter, architecture.residual_gain)
            else:
                nn.init.zeros_(parameter)

    def forward(self, images: Tensor, num_past: int) -> Output:
        """Reconstruct all frames [B, T, C, H, W] with inferred latents.

        In training, skips come from a random frame and the content from random frames of the clip.
        """
        codes, all_skips = self._encode(images)
        batch, num_frames = codes.shape[:2]
        clips = torch.arange(batch, device=images.device)
        steps = torch.randint(num_frames, size=(batch,)).to(images.device)
        skips = [maps[clips, steps] for maps in all_skips]
        shuffled = torch.stack([torch.randperm(num_frames) for _ in range(batch)])
        some = shuffled[:, : self.architecture.first_frames].to(images.device)
        content = self.content(codes[clips[:, None], some])
        first, posteriors = self._first(codes), self._posteriors(codes)
        states, latents, residuals = [first.rsample()], [], []
        for posterior in posteriors:
            latents.append((posterior, softplus_normal(self.p_z(states[-1]))))
            state, residual = self.next_state(states[-1], posterior.rsample())
            states.append(state)
            residuals.append(residual)
        decoded = self._decode(torch.stack(states, dim=1), content, skips)
        return Output(decoded, first, latents, torch.stack(residuals, dim=1))

    def predict(self, observed: Tensor, noise: Tensor) -> Tensor:
        """Predict futures [N, F, C, H, W]; the first noise decides on the first state."""
        architecture, num_past = self.architecture, observed.shape[1]
        codes, all_skips = self._encode(observed)
        content = self.content(codes[:, -architecture.first_frames :])
        skips = [maps[:, -1] for maps in all_skips]
        state = drawn(self._first(codes), noise[:, 0, : architecture.state_size])
        posteriors, frames = self._posteriors(codes), []
        for step in range(1, noise.shape[1]):
            is_observed = step < num_past
            latent = posteriors[step - 1] if is_observed else softplus_normal(self.p_z(state))
            sample = drawn(latent, noise[:, step, : architecture.latent_size])
            state, _ = self.next_state(state, sample)
            if not is_observed:
                frames.append(self._decode(state[:, None], content, skips))
        return torch.cat(frames, dim=1)

    def content(self, codes: Tensor) -> Tensor:
        """Return the content w [B, inference_size] of frames with codes [B, T, code_size], in any
        order.
        """
        return self.w_inf(self.w_proj(codes).sum(dim=1))

    def next_state(self, state: Tensor, latent: Tensor) -> tuple[Tensor, Tensor]:
        """Return the state [B, Y] one frame later by Euler steps, and the residuals [B,
        steps_per_frame, Y].
        """
        residuals, step = [], 1 / self.architecture.steps_per_frame
        for _ in range(self.architecture.steps_per_frame):
            residuals.append(step * self.dynamics(torch.cat([state, latent], dim=-1)))
            state = state + residuals[-1]
        return state, torch.stack(residuals, dim=1)

    def _encode(self, images: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return codes [B, T, code_size] and skips [B, T, ...]."""
        flat, skips = self.encoder(images.flatten(0, 1))
        codes, *skips = (maps.unflatten(0, images.shape[:2]) for maps in (flat, *skips))
        return codes, skips

    def _first(self, codes: Tensor) -> Normal:
        """Infer the first state from the first codes; the last is repeated where there are too
        few.
        """
        steps = torch.arange(self.architecture.first_frames).clamp(max=codes.shape[1] - 1)
        return softplus_normal(self.q_y(codes[:, steps].flatten(1)))

    def _posteriors(self, codes: Tensor) -> list[Normal]:
        """Infer the latents of all steps but the first."""
        return [softplus_normal(raw) for raw in self.q_z(self.inf_z(codes)[0]).unbind(1)[1:]]

    def _decode(self, states: Tensor, content: Tensor, skips: list[Tensor]) -> Tensor:
        """Decode states [B, T, Y] to images [B, T, C, H, W], with skips of one frame."""
        num_steps = states.shape[1]
        codes = torch.cat([content[:, None].expand(-1, num_steps, -1), states], dim=-1)
        repeated = [maps.repeat_interleave(num_steps, dim=0) for maps in skips]
        return self.decoder(codes.flatten(0, 1), repeated).unflatten(0, (-1, num_steps))


@dataclass(frozen=True)
class SrvpTraining(VideoTraining):
    """Training of SRVP on the evidence lower bound; with all betas 1 it is exact, in nats.

    Residuals are penalised as in the authors' train.py: by the sum of their Euclidean lengths over
    all Euler steps.
    """

    architecture: Architecture = field(default_factory=Architecture)
    observation_std: float = 0.2  # of a pixel's value around the decoded one
    beta_first: float = 1.0  # weight of the first state's KL divergence
    beta: float = 1.0  # weight of the latents' KL divergence
    residual_weight: float = 1.0

    network = SrvpNetwork

    def losses(self, network: nn.Module, images: Tensor, step: int = 0) -> Losses:
        """Return the nats of a clip."""
        output: Output = network(images, self.num_past)
        pixels = Normal(output.images, self.observation_std)
        error = -pixels.log_prob(images).sum() / len(images)
        first = kl_divergence(output.first, Normal(0.0, 1.0)).sum(-1).mean()
        nats = summed_nats(output.latents)
        residual = output.residuals.norm(dim=-1).sum((1, 2)).mean()
        total = error + self.beta_first * first + self.beta * nats + self.residual_weight * residual
        return {
            "total": total,
            "error": error,
            "first_nats": first,
            "nats": nats,
            "residual": residual,
        }


def softplus_normal(raw: Tensor) -> Normal:
    """Return the normal distributions of a network's output [..., 2 * D]: D means, then D numbers
    whose softplus is the standard deviation.
    """
    mean, spread = raw.float().chunk(2, dim=-1)
    return Normal(mean, functional.softplus(spread) + MIN_STD)
