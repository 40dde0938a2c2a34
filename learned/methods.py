"""What the training loop asks of a method, and which methods there are."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from torch import Tensor, nn
from torch.optim import Optimizer

from geovp_classic.errors import UnknownComponent
from geovp_classic.registry import nearest
from geovp_classic.types import Clip

Batch = dict[str, Tensor]
Losses = dict[str, Tensor]  # scalars; "total" is what is minimised, all are logged
Networks = Mapping[str, nn.Module]

METHODS = {  # imported when asked for by name
    "deepvo": "learned.deepvo.train:DeepVoTraining",
    "svg": "learned.svg.train:SvgTraining",
    "srvp": "learned.srvp.train:SrvpTraining",
    "slamp": "learned.slamp.train:SlampTraining",
    "synsin": "learned.synsin.train:SynSinTraining",
}


class Method(Protocol):
    """A frozen dataclass whose fields are its settings; numbers, texts, tuples and such dataclasses of them.

    Networks and optimisers go by names. What happens at a step may depend on nothing but the networks, the batch and
    torch's own random numbers, which the loop seeds anew at every step: so a killed run goes on exactly.
    """

    @property
    def kept(self) -> tuple[str, ...]:
        """The networks that the weights file holds; the others (a discriminator) only serve training."""
        ...

    def build(self) -> dict[str, nn.Module]:
        """Fresh networks, drawn from torch's random numbers."""
        ...

    def optimisers(self, networks: Networks) -> dict[str, Optimizer]:
        """One optimiser for each network that learns, under that network's name."""
        ...

    def examples(self, clips: Iterable[Clip], *, training: bool) -> Sequence[Any]:
        """What it learns from, or is validated on, held in memory; BadData when a clip lacks something."""
        ...

    def batch(self, examples: Sequence[Any], indices: Sequence[int], rng: np.random.Generator) -> Batch:
        """Tensors of the chosen training examples, augmented by draws from `rng`."""
        ...

    def training_step(self, networks: Networks, batch: Batch, step: int) -> Iterator[tuple[str, Losses]]:
        """Turn by turn, which network learns and from what; before the next turn it has made its step."""
        ...

    def validate(self, networks: Networks, examples: Sequence[Any]) -> dict[str, float]:
        """Numbers for the log; "score" (lower is better) says which weights are kept."""
        ...


def load(name: str) -> type[Method]:
    """The method of a name; UnknownComponent with the nearest one."""
    if name not in METHODS:
        raise UnknownComponent(f"no method is called {name!r}{nearest(name, METHODS)}")
    module, _, attribute = METHODS[name].partition(":")
    method: type[Method] = getattr(importlib.import_module(module), attribute)
    return method
