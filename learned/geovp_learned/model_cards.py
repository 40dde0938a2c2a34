"""Model cards: the metadata of a weights file and the curves of its training log, as Markdown."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from geovp_classic.errors import BadData
from geovp_learned import checkpoints, training_config, training_log

KITTI_LICENCE = (
    "Trained on KITTI (Geiger et al. 2012), whose licence CC BY-NC-SA 3.0 passes on to these "
    "weights: attribution, no "
    "commercial use, share alike. The rest of this repository is Apache-2.0."
)
MAX_ROWS = 25


def model_card(
    weights: Path,
    config: Path | None = None,
    log: Path | None = None,
    changes: training_config.Changes = training_config.NO_CHANGES,
) -> str:
    """Write the model card of a weights file; with a training log also its curves, in about
    MAX_ROWS rows.

    With a config also the command that trained it; BadData unless the weights have the settings of
    the config with these changes.
    """
    metadata, tensors = checkpoints.read_tensors(weights)
    history = metadata.get("history", {})
    parts = [
        f"# Weights of {metadata.get('method')}",
        _facts(weights, history, sum(tensor.numel() for tensor in tensors.values())),
        *([] if config is None else [_command(weights, metadata, config, changes)]),
        "## Trained on\n\n" + _bullets(map(_dataset, history.get("train", []))),
        "## Validated on\n\n" + _bullets(map(_dataset, history.get("validation", []))),
        "## Scores of these weights on the validation data\n\n"
        + _bullets(f"{name}: {value:.4g}" for name, value in history.get("scores", {}).items()),
        f"## Settings\n\n```json\n{json.dumps(metadata.get('settings'), indent=1)}\n```",
    ]
    if log is not None:
        parts.append("## Curves\n\n" + curves(training_log.read(log)))
    if any(dataset.get("name") == "kitti" for dataset in history.get("train", [])):
        parts.append("## Licence\n\n" + KITTI_LICENCE)
    return "\n\n".join(parts) + "\n"


def curves(rows: Iterable[Mapping[str, float]]) -> str:
    """Return a table with a row per validation; training losses are means since the row before."""
    rows = list(rows)
    names = sorted({name for row in rows for name in row} - {"step", "seconds"}, reverse=True)
    validated = [row for row in rows if "validation/score" in row]
    stride = -(-len(validated) // MAX_ROWS) or 1
    lines = [["step", "seconds", *names], ["--:"] * (2 + len(names))]
    before = 0.0
    for row in reversed(validated[::-1][::stride]):
        recent = [each for each in rows if before < each["step"] <= row["step"]]
        before = row["step"]
        means = (
            np.mean([each[name] for each in recent if name in each] or [np.nan])
            if name.startswith("train/")
            else row.get(name, np.nan)
            for name in names
        )
        numbers = [row["step"], row["seconds"], *means]
        lines.append([f"{number:.4g}" for number in numbers])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _command(
    weights: Path, metadata: Mapping[str, Any], config: Path, changes: training_config.Changes
) -> str:
    name = str(metadata.get("method"))
    method, training, _ = training_config.settings(name, config, changes)
    wanted = {"method": checkpoints.plain(method), "training": training.decisive}
    stored = checkpoints.read(weights, name, type(method))[
        0
    ]  # with defaults for fields that are newer than the file
    given = {
        "method": checkpoints.plain(stored),
        "training": metadata.get("history", {}).get("training"),
    }
    for table in wanted:
        if wanted[table] != given[table]:
            raise BadData(
                f"{weights} was trained with another [{table}] than {config} has: give its own "
                "config"
            )
    options = [f" --{key} {value}" for key, value in changes.given.items()]
    return f"Trained by\n\n    python -m geovp_learned train {name} {config}{''.join(options)}"


def _facts(weights: Path, history: Mapping[str, Any], count: int) -> str:
    training = history.get("training", {})
    facts = [
        f"{count:,} numbers in {weights.stat().st_size / 1e6:.2f} MB (safetensors, half precision)",
        f"the best of the run's validations, after {history.get('step')} of "
        f"{training.get('num_steps')} steps of "
        f"{training.get('batch_size')} examples and {history.get('seconds')} s",
        f"seed {training.get('seed')}, warm-up {training.get('warmup_steps')} steps, "
        f"precision {training.get('precision')}",
    ]
    if steps := training.get("average_steps"):
        facts.append(f"exponential moving average (EMA) of the weights over {steps} steps")
    return _bullets(facts)


def _dataset(table: Mapping[str, Any]) -> str:
    settings = ", ".join(
        f"{key} {value}" for key, value in table.items() if key not in ("name", "split_hash")
    )
    tail = f"; SHA-256 of its ranges `{table['split_hash']}`" if "split_hash" in table else ""
    return f"`{table.get('name')}`: {settings}{tail}"


def _bullets(items: Iterable[str]) -> str:
    return "\n".join(f"- {item}" for item in items)
