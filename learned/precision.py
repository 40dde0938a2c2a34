"""Mixed precision that does not round the networks' inputs.

Fabric's own casts every input: a focal length of 489.5 pixels becomes 490 in bfloat16, a distance of 12.3 m 12.31 m,
also for the parts of a network that run in full precision.
"""

from __future__ import annotations

from typing import Any, Literal

import torch
from lightning.fabric.plugins import MixedPrecision, Precision

from learned.training_config import Training


class FullPrecisionInputs(MixedPrecision):
    """Autocast without casting the inputs."""

    def convert_input(self, data: Any) -> Any:
        """The data itself."""
        return data


def plugins(settings: Training) -> tuple[Precision, ...]:
    """Fabric's plugin for "16-mixed" and "bf16-mixed"; none for the other precisions, which Fabric has.

    Without a GPU "16-mixed" is "bf16-mixed", as in Fabric: CPUs do not compute in float16.
    """
    if not settings.precision.endswith("-mixed"):
        return ()
    on_cpu = settings.accelerator == "cpu" or (settings.accelerator == "auto" and not torch.cuda.is_available())
    kind: Literal["16-mixed", "bf16-mixed"]
    kind = "bf16-mixed" if on_cpu or settings.precision == "bf16-mixed" else "16-mixed"
    return (FullPrecisionInputs(kind, "cpu" if on_cpu else "cuda"),)
