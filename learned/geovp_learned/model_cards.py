"""Model cards: the metadata of a weights file and the curves of its training log, as Markdown."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import jinja2
import numpy as np

from geovp_classic import files
from geovp_learned import checkpoints, training_log

TEMPLATE = Path(__file__).with_name("model_card.md")
MAX_ROWS = 25


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


def curves(rows: Sequence[Mapping[str, float]]) -> list[list[str]]:
    """Return a table of about MAX_ROWS rows, one per validation; training losses are means since
    the row before.
    """
    names = sorted({name for row in rows for name in row} - {"step", "seconds"}, reverse=True)
    validated = [row for row in rows if "validation/score" in row]
    stride = -(-len(validated) // MAX_ROWS) or 1
    table = [["step", "seconds", *names], ["--:"] * (2 + len(names))]
    before = 0.0
    for row in reversed(validated[::-1][::stride]):
        recent = [each for each in rows if before < each["step"] <= row["step"]]
        before = row["step"]
        numbers = [row["step"], row["seconds"]]
        for name in names:
            source = recent if name.startswith("train/") else [row]
            values = [each[name] for each in source if name in each]
            numbers.append(float(np.mean(values or [np.nan])))
        table.append([f"{number:.4g}" for number in numbers])
    return table
