"""What a training runs on, by Lightning Fabric: processors, precision, and what a setting of them
is worth here.
"""

import torch
from lightning.fabric import Fabric
from lightning.fabric.plugins import MixedPrecision

from geovp_classic.errors import BadData
from geovp_learned.training_config import Training


def check_precision(settings: Training) -> None:
    """Raise BadData if a processor lacks bfloat16: convolutions take about fifteen times as long,
    LSTMs fail.
    """
    on_cpu = settings.accelerator == "cpu" or (
        settings.accelerator == "auto" and not torch.cuda.is_available()
    )
    capability = torch.backends.cpu.get_cpu_capability()
    if on_cpu and "bf16" in settings.precision and capability in ("AVX2", "DEFAULT"):
        reason = f"needs a processor with AVX-512 or AMX, or a GPU (this processor: {capability})"
        raise BadData(f"precision {settings.precision} {reason}: give --precision 32-true")


def fabric(settings: Training) -> Fabric:
    """Build Lightning Fabric from the settings; raise BadData if it refuses them."""
    names = ("accelerator", "devices", "num_nodes", "strategy", "precision")
    try:
        fabric = Fabric(**{name: getattr(settings, name) for name in names})
    except (ValueError, RuntimeError, ImportError) as problem:
        raise BadData(f"[training] does not fit this machine: {problem}") from problem
    keep_inputs(fabric)
    return fabric


def keep_inputs(fabric: Fabric) -> None:
    """Let mixed precision compute in halves, but not round the inputs: a focal length of 489.5
    would become 490 px.
    """
    if isinstance(precision := fabric.strategy.precision, MixedPrecision):
        precision.convert_input = lambda data: data  # type: ignore[method-assign]
