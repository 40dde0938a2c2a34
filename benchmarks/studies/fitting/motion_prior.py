"""Fit of the motion prior: the central path, then the spread of its errors on held-out roads."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor, distributions
from torch.nn import functional

from geovp_classic.forecasting.motion_network import (
    Network,
    PriorCoefficients,
    damped_turn,
    past_features,
    spread_features,
)
from geovp_classic.types import FloatArray
from studies.fitting.windows import STEP_S, Windows, along_path, augmented, joined


@dataclass(frozen=True)
class Ensemble:
    """Independent perceptrons with two hidden layers, trained by AdamW (Loshchilov & Hutter 2019).

    The learning rate has one cycle (Smith 2018). Biases do not decay.
    """

    num_members: int
    width: int
    num_steps: int
    learning_rate: float = 2e-3
    weight_decay: float = 1e-2
    dropout: float = 0.1
    batch_size: int = 256
    limit: float = 8.0  # deviations at which features are clipped
    seed: int = 0

    def fit(
        self,
        features: FloatArray,  # [N, in]
        targets: FloatArray,  # [N, ...]
        num_outputs: int,
        loss: Callable[[Tensor, Tensor], Tensor],  # of outputs [M, B, out] and targets [M, B, ...]
    ) -> Network:
        """Return the trained network."""
        torch.manual_seed(self.seed)
        torch.set_num_threads(1)  # faster for such small layers
        weights = []
        biases = []
        sizes = (features.shape[1], self.width, self.width, num_outputs)
        for num_in, num_out in itertools.pairwise(sizes):
            weight = torch.randn(self.num_members, num_in, num_out, dtype=torch.float64)
            weights.append((weight / num_in**0.5).requires_grad_())
            biases.append(torch.zeros_like(weight[:, :1]).requires_grad_())
        # The arrays share the memory of the parameters that are trained.
        arrays = [[layer.detach().numpy() for layer in layers] for layers in (weights, biases)]
        mean = features.mean(axis=0)
        network = Network(mean, features.std(axis=0) + 1e-6, self.limit, *arrays)
        inputs = torch.from_numpy(network.standardised(features))
        goals = torch.from_numpy(targets)
        optimizer = torch.optim.AdamW(weights, self.learning_rate, weight_decay=self.weight_decay)
        optimizer.add_param_group({"params": biases, "weight_decay": 0.0})
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimizer, self.learning_rate, self.num_steps, pct_start=0.15, cycle_momentum=False
        )
        for _ in range(self.num_steps):
            drawn = torch.randint(len(inputs), (self.num_members, self.batch_size))
            hidden = inputs[drawn]
            for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
                hidden = functional.dropout(functional.silu(hidden @ weight + bias), self.dropout)
            losses = loss(hidden @ weights[-1] + biases[-1], goals[drawn])
            optimizer.zero_grad()
            # Averaged over the batch and summed over members, which stay independent.
            losses.flatten(1).mean(dim=1).sum().backward()
            optimizer.step()
            schedule.step()
        return network


@dataclass(frozen=True)
class PriorFit:
    """Settings of the fit, selected by cross-validation on the training sequences and on `val`."""

    centre: Ensemble = Ensemble(num_members=2, width=96, num_steps=2000)
    spread: Ensemble = Ensemble(
        num_members=3,
        width=48,
        num_steps=1500,
        learning_rate=1e-3,
        weight_decay=0.05,
        dropout=0.2,
        limit=3.0,
    )
    num_copies: int = 8  # of the windows, differently augmented
    yaw_weight_m: float = 8.0  # metres that a radian of yaw error counts as
    num_modes: int = 6
    depth: int = 12  # smooth deviations of which the modes are made

    def fit(self, sequences: Sequence[Windows]) -> PriorCoefficients:
        """Fit the path to all sequences, and the spread to errors on sequences held out in turn."""
        errors = []
        for number, held_out in enumerate(sequences):
            centre = self.fit_centre([*sequences[:number], *sequences[number + 1 :]])
            noisy = augmented(held_out, np.random.default_rng(number))
            twists, states = joined([held_out, noisy])
            paths = centre.central_paths(twists)
            errors.append((twists, paths, along_path(states[..., :3] - paths, paths)))
        return self.fit_spread(self.fit_centre(sequences), *joined(errors))

    def fit_centre(self, sequences: Sequence[Windows]) -> PriorCoefficients:
        """Fit the central path to distances plus weighted yaw errors; it has no spread yet."""
        rng = np.random.default_rng(self.centre.seed)
        twists, states = joined(augmented(joined(sequences), rng) for _ in range(self.num_copies))
        corrections = states[..., :3] - damped_turn(twists, STEP_S, states.shape[1])
        scale = np.abs(corrections).mean(axis=0) + 1e-3

        def loss(outputs: Tensor, corrections: Tensor) -> Tensor:
            error = outputs.reshape(corrections.shape) * torch.from_numpy(scale) - corrections
            distance = torch.sqrt((error[..., :2] ** 2).sum(dim=-1) + 1e-4)
            return distance + self.yaw_weight_m * torch.sqrt(error[..., 2] ** 2 + 1e-6)

        network = self.centre.fit(past_features(twists), corrections, scale.size, loss)
        return PriorCoefficients(STEP_S, scale, network, network, scale[..., None], scale)

    def fit_spread(
        self,
        centre: PriorCoefficients,
        twists: FloatArray,  # [N, P, 6], per second
        paths: FloatArray,  # [N, F, 3]
        deviations: FloatArray,  # [N, F, 3], of the truth, along the paths
    ) -> PriorCoefficients:
        """Fit a mixture of Gaussians over the deviations' principal components given the past."""
        variance = (deviations**2).mean(axis=0) + 1e-10
        white = deviations / np.sqrt(variance)
        left, _, _ = np.linalg.svd(white.reshape(len(white), -1), full_matrices=False)
        amounts = left[:, : self.depth] * len(white) ** 0.5  # of unit variance
        basis = np.einsum("nfc,nd->fcd", deviations, amounts) / len(white)

        def loss(outputs: Tensor, amounts: Tensor) -> Tensor:
            logits = outputs[..., : self.num_modes]
            modes = outputs[..., self.num_modes :].unflatten(-1, (2, self.num_modes, self.depth))
            means, log_deviations = modes.unbind(dim=-3)
            normal = distributions.Normal(means, log_deviations.clamp(-4.0, 3.0).exp())
            mixture = distributions.MixtureSameFamily(
                distributions.Categorical(logits=logits), distributions.Independent(normal, 1)
            )
            return -mixture.log_prob(amounts)

        num_outputs = self.num_modes * (1 + 2 * self.depth)
        network = self.spread.fit(spread_features(twists, paths), amounts, num_outputs, loss)
        residual = variance - (basis**2).sum(axis=-1)
        return replace(centre, spread=network, basis=basis, residual_variance=residual)


def arrays_of(fitted: PriorCoefficients) -> dict[str, FloatArray]:
    """Return the arrays of a file, as `geovp_classic.forecasting.motion_prior.load` reads them."""
    arrays = {
        "step_s": np.array(fitted.step_s),
        "centre_scale": fitted.centre_scale,
        "basis": fitted.basis,
        "floor": fitted.residual_variance,
    }
    for name, network in (("centre", fitted.centre), ("spread", fitted.spread)):
        arrays |= {f"{name}_mean": network.mean, f"{name}_deviation": network.deviation}
        for kind, layers in (("weight", network.weights), ("bias", network.biases)):
            for number, layer in enumerate(layers):
                arrays[f"{name}_{kind}{number}"] = layer.astype(np.float32)
    return arrays
