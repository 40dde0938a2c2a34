"""Model cards: the metadata of a weights file and the curves of its training log, as Markdown."""

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path

import jinja2

from geovp_classic import files
from geovp_learned import checkpoints, training_log

TEMPLATE = Path(__file__).with_name("model_card.md")


def model_card(weights: Path, log: Path | None = None) -> str:
    """Write the model card of a weights file; with a training log also its curves.

    Raises BadData if training did not write the file.
    """
    metadata, tensors = checkpoints.read_tensors(weights)
    template = jinja2.Template(files.read_text(TEMPLATE), trim_blocks=True)
    with files.checked(f"{weights} has no card", "give weights written by a training"):
        return template.render(
            metadata,
            settings=json.dumps(metadata["settings"], indent=1),
            count=sum(tensor.numel() for tensor in tensors.values()),
            size_mb=weights.stat().st_size / 1e6,
            curves=curves(training_log.read(log)) if log else [],
        )


def curves(rows: Iterable[Mapping[str, float]]) -> list[dict[str, float]]:
    """Return what was logged at the steps with a validation."""
    steps: dict[float, dict[str, float]] = defaultdict(dict)
    for row in rows:
        steps[row["step"]] |= row
    return [row for row in steps.values() if "validation/score" in row]
