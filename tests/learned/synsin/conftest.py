"""A small street at 32x32 pixels, and SynSin small enough to learn it in seconds."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import street
import torch
from torch import nn
from torch.utils.data import default_collate

from geovp_classic.geometry import pinhole
from geovp_classic.types import Clip
from geovp_learned.methods import Losses
from geovp_learned.stored_clips import Window
from geovp_learned.synsin import pairs
from geovp_learned.synsin.network import Architecture
from geovp_learned.synsin.train import SynSinTraining, Weights


@pytest.fixture(scope="session")
def clip() -> Clip:
    """Ten frames of the contracts' street, averaged to a quarter of its size."""
    whole = street.clip()
    return replace(
        whole,
        frames=np.stack([pinhole.resize(frame, (32, 32)) for frame in whole.frames]),
        intrinsics=whole.intrinsics.resized(32, 32),
        depths=None,
        moving=None,
    )


@pytest.fixture(scope="session")
def method() -> SynSinTraining:
    """SynSin without losses that need files or another network."""
    return SynSinTraining(
        Architecture(features=8, width=8),
        Weights(content=0.0, adversarial=0.0),
        max_horizon=2,
        grey_probability=0.0,
        discriminator_width=8,
        rate=1e-2,
    )


@pytest.fixture(scope="session")
def trained() -> Callable[..., Any]:
    return _trained


def _trained(
    method: SynSinTraining, examples: Sequence[Window], num_steps: int
) -> tuple[dict[str, nn.Module], list[Losses]]:
    """The networks after some steps on all examples at once, as they are, and the losses of every
    step.
    """
    torch.manual_seed(0)
    networks = method.build()
    optimisers = method.optimisers(networks)
    batch = default_collate([pairs.frame_pairs(one, [2]) for one in examples])
    history = []
    for step in range(num_steps):
        losses: Losses = {}
        for turn, parts in method.training_step(networks, batch, step).items():
            optimisers[turn].zero_grad()
            parts["total"].backward()
            optimisers[turn].step()
            losses |= {f"{turn}.{name}": part.detach() for name, part in parts.items()}
        history.append(losses)
    return networks, history
