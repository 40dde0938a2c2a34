"""Mixed precision that leaves what networks are given as it is.

Fabric's own rounds every input to halves: a focal length of 489.5 pixels becomes 490 in bfloat16, a camera 12.3 m away
12.31, and networks that compute parts in full precision get what they cannot use.
"""

from __future__ import annotations

from typing import Any, Literal

import torch
from lightning.fabric import Fabric
from lightning.fabric.plugins import MixedPrecision, Precision

from learned.recipes import Training


class InputsInFull(MixedPrecision):
    """Layers choose their own precision, inputs keep theirs."""

    def convert_input(self, data: Any) -> Any:
        """The data itself."""
        return data


def loss_scale(fabric: Fabric) -> dict[str, Any]:
    """By what losses are multiplied, so that small gradients do not vanish in halves; empty in other precisions."""
    return dict(fabric.strategy.precision.state_dict())


def load_loss_scale(fabric: Fabric, state: dict[str, Any]) -> None:
    """Go on with the factor of an earlier start."""
    if state:
        fabric.strategy.precision.load_state_dict(state)


def plugins(settings: Training) -> tuple[Precision, ...]:
    """What to give Fabric beside its own precisions: one for "16-mixed" and "bf16-mixed", else nothing.

    Without a GPU "16-mixed" is "bf16-mixed", as in Fabric: CPUs have no arithmetic in the other halves.
    """
    if not settings.precision.endswith("-mixed"):
        return ()
    on_cpu = settings.accelerator == "cpu" or (settings.accelerator == "auto" and not torch.cuda.is_available())
    kind: Literal["16-mixed", "bf16-mixed"]
    kind = "bf16-mixed" if on_cpu or settings.precision == "bf16-mixed" else "16-mixed"
    return (InputsInFull(kind, "cpu" if on_cpu else "cuda"),)
