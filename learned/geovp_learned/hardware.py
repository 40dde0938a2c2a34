"""What a training runs on, by Lightning Fabric: processors and precision."""

import torch
from lightning.fabric import Fabric
from lightning.fabric.plugins import MixedPrecision

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_learned.training_config import Training


def fabric(settings: Training) -> Fabric:
    """Build Lightning Fabric from the settings; raise BadData if it refuses them, or if a processor
    lacks bfloat16: convolutions take about fifteen times as long, LSTMs fail.
    """
    names = ("accelerator", "devices", "num_nodes", "strategy", "precision")
    with files.checked("[training] does not fit this machine", "change it"):
        fabric = Fabric(**{name: getattr(settings, name) for name in names})
    capability = torch.backends.cpu.get_cpu_capability()
    is_slow = fabric.device.type == "cpu" and capability in ("AVX2", "DEFAULT")
    if is_slow and "bf16" in settings.precision:
        reason = f"needs a processor with AVX-512 or AMX, or a GPU (this processor: {capability})"
        raise BadData(f"precision {settings.precision} {reason}: give --precision 32-true")
    keep_inputs(fabric)
    return fabric


def keep_inputs(fabric: Fabric) -> None:
    """Let mixed precision compute in halves, but not round the inputs: a focal length of 489.5
    would become 490 px.
    """
    if isinstance(precision := fabric.strategy.precision, MixedPrecision):
        precision.convert_input = lambda data: data  # type: ignore[method-assign]
