"""Weights and images that the authors' networks and ours can both be given.

The expected numbers in the tests of equality were computed once with the authors' own code
(edenton/svg, edouardelasalles/srvp, kaanakan/slamp, facebookresearch/synsin and
ChiWeiHsiao/DeepVO-pytorch at their newest commits of 2026-11): each of their networks was built on
the CPU with the sizes that the test names, given `seed_weights` and `random_images`, and run as
their scripts run it. Random numbers of a distribution were replaced by HALF everywhere, so that a
sample is the mean plus half a standard deviation. Batch normalisation was in evaluation mode for
predictions, and in training mode for losses. `digest` picks the numbers.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np
import torch
from torch import Tensor, nn
from torch.distributions import Normal
from torch.nn import functional

HALF = 0.5
DIGEST = 24


def seed_weights(module: nn.Module, variance: float = 2.0) -> None:
    """Fill the floating-point tensors of a module in the order of its state dict; the n-th is drawn
    with seed n: matrices with the variance `variance` / inputs, others around 0, or 1 for gains and variances.
    """
    tensors = {
        name: tensor for name, tensor in module.state_dict().items() if tensor.is_floating_point()
    }
    for seed, (name, tensor) in enumerate(tensors.items()):
        drawn = torch.from_numpy(np.random.default_rng(seed).standard_normal(tensor.shape))
        if tensor.ndim > 1:
            drawn *= math.sqrt(variance / math.prod(tensor.shape[1:]))
        elif name.endswith("_var"):
            drawn = 1 + 0.1 * drawn.abs()
        else:
            drawn = 0.1 * drawn + name.endswith("weight")
        tensor.copy_(drawn)
    for name in tensors:
        if name.endswith("_u"):
            _iterate_power(tensors, name)


def _iterate_power(tensors: dict[str, Tensor], name: str) -> None:
    """Set the vectors of spectral normalisation after one iteration from ones, under torch's former
    and present names.
    """
    original = name.replace("weight_u", "weight_orig").replace("0._u", "original")
    matrix = tensors[original].flatten(1)
    right = functional.normalize(matrix.sum(0), dim=0)
    tensors[f"{name[:-1]}v"].copy_(right)
    tensors[name].copy_(functional.normalize(matrix @ right, dim=0))


def random_images(*shape: int) -> Tensor:
    return torch.from_numpy(np.random.default_rng(1234).random(shape)).float()


def numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def digest(tensor: Tensor) -> list[float]:
    """Return 24 randomly chosen numbers of a tensor."""
    flat = tensor.detach().flatten()
    chosen = np.random.default_rng(99).integers(0, len(flat), DIGEST)
    return [round(float(flat[index]), 6) for index in chosen]


@contextmanager
def half_a_deviation() -> Iterator[None]:
    """Let samples be the mean plus half a standard deviation."""
    with patch.object(Normal, "rsample", lambda self: self.mean + HALF * self.stddev):
        yield
