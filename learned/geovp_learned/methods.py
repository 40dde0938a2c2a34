"""The interface between the training loop and the methods, and the list of methods."""

import pkgutil
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from torch import Tensor, nn
from torch.optim import Optimizer

from geovp_classic.errors import UnknownComponent
from geovp_classic.registry import nearest
from geovp_classic.types import Clip
from geovp_learned.stored_clips import Arrays

Batch = dict[str, Tensor]
Losses = dict[str, Tensor]  # scalars; "total" is minimised, all are logged
Networks = Mapping[str, nn.Module]

METHODS = {  # imported when asked for by name
    "deepvo": "geovp_learned.deepvo.train:DeepVoTraining",
    "svg": "geovp_learned.video.svg:SvgTraining",
    "srvp": "geovp_learned.video.srvp:SrvpTraining",
    "slamp": "geovp_learned.video.slamp:SlampTraining",
    "synsin": "geovp_learned.synsin.train:SynSinTraining",
}


class Method(Protocol):
    """A frozen dataclass whose fields are its settings: numbers, strings, tuples and dataclasses of
    these.

    Networks have names. A step may depend on the networks, the batch and torch's random numbers
    alone; the loop seeds these at every step, so that a killed run can be resumed exactly.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def build(self) -> dict[str, nn.Module]:
        """Build new networks, initialised with torch's random numbers; the first predicts and is
        stored, others (a discriminator) only serve training.
        """

    def optimisers(self, networks: Networks) -> dict[str, Optimizer]:
        """Build the optimiser of each network, under that network's name."""

    def prepare(self, clip: Clip) -> Arrays:
        """Return what examples need of a clip, at the network's size; it is stored on disk.

        Raises BadData if the clip lacks something.
        """

    def examples(self, clips: Sequence[Arrays], *, training: bool) -> Sequence[Any]:
        """Return the places of the examples for training or validation in prepared clips."""

    def example(self, item: Any, rng: np.random.Generator) -> Batch:
        """Return tensors of a training example, augmented with `rng`; batches stack them."""

    def training_step(self, networks: Networks, batch: Batch, step: int) -> dict[str, Losses]:
        """Return the losses of each network that learns in this step."""

    def validation_example(self, item: Any) -> Batch:
        """Return tensors of a validation example; batches stack them."""

    def validation_step(self, networks: Networks, batch: Batch) -> dict[str, Tensor]:
        """Return numbers for the log, as means over the batch; the weights with the lowest "score"
        are kept.
        """


def load(name: str) -> type[Method]:
    """Return the method of a name; raise UnknownComponent with the nearest name."""
    if name not in METHODS:
        raise UnknownComponent(f"no method is called {name!r}{nearest(name, METHODS)}")
    return pkgutil.resolve_name(METHODS[name])
