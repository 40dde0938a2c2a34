"""Model cards: what a weights file says of itself, and the curves of its training log, as Markdown."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from geovp_classic.errors import BadData
from learned import checkpoints, recipes, training_log

KITTI_LICENCE = (
    "Trained on KITTI (Geiger et al. 2012), whose licence CC BY-NC-SA 3.0 passes on to these weights: attribution, no "
    "commercial use, share alike. The rest of this repository is Apache-2.0."
)
MOST_ROWS = 25


def card(weights: Path, recipe: Path | None = None, log: Path | None = None) -> str:
    """The card of a weights file; with a training log, its curves, thinned out to MOST_ROWS rows.

    With a recipe, the command that trains such weights; BadData unless they have the recipe's own settings.
    """
    metadata, tensors = checkpoints.read_tensors(weights)
    history = metadata.get("history", {})
    parts = [
        f"# Weights of {metadata.get('method')}",
        _facts(weights, metadata, history, sum(tensor.numel() for tensor in tensors.values())),
        *([] if recipe is None else [_command(weights, metadata, recipe)]),
        "## Trained on\n\n" + _listed(map(_dataset, history.get("train", []))),
        "## Validated on\n\n" + _listed(map(_dataset, history.get("validation", []))),
        "## Scores of these weights on the validation data\n\n" + _listed(_numbers(history.get("scores", {}))),
        f"## Settings\n\n```json\n{json.dumps(metadata.get('settings'), indent=1)}\n```",
    ]
    if log is not None:
        parts.append("## Curves\n\n" + curves(training_log.read(log)))
    if any(dataset.get("name") == "kitti" for dataset in history.get("train", [])):
        parts.append("## Licence\n\n" + KITTI_LICENCE)
    return "\n\n".join(parts) + "\n"


def _command(weights: Path, metadata: Mapping[str, Any], recipe: Path) -> str:
    method_name = str(metadata.get("method"))
    method, training = recipes.settings(method_name, recipe)
    theirs = {"method": checkpoints.plain(method), "training": training.decisive}
    ours = {"method": metadata.get("settings"), "training": metadata.get("history", {}).get("training")}
    for table, fields in theirs.items():
        if fields != ours[table]:
            raise BadData(f"{weights} was trained with another [{table}] than {recipe} has: give its own recipe")
    return f"Trained by\n\n    python -m learned train {method_name} {recipe}"


def curves(rows: Iterable[Mapping[str, str]]) -> str:
    """A table with a row for a validation and a column for a number; training losses are means since the row before."""
    validated: dict[int, dict[str, float]] = {}
    trained: list[tuple[int, str, float]] = []
    for row in rows:
        step, name, value = int(row["step"]), row["name"], float(row["value"])
        if row["split"] == "validation":
            validated.setdefault(step, {"seconds": float(row["seconds"])})[name] = value
        else:
            trained.append((step, name, value))
    steps = sorted(validated)
    kept = [step for place, step in enumerate(steps) if place % -(-len(steps) // MOST_ROWS) == 0 or step == steps[-1]]
    columns = list(validated[steps[0]]) if steps else []
    losses = list(dict.fromkeys(name for _, name, _ in trained))
    lines = [["step", *columns, *(f"training {name}" for name in losses)]]
    for before, step in zip([0, *kept], kept, strict=False):
        means = (_mean(v for at, n, v in trained if n == name and before < at <= step) for name in losses)
        lines.append([str(step), *(f"{validated[step].get(name, float('nan')):.4g}" for name in columns), *means])
    lines.insert(1, ["--:"] * len(lines[0]))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _facts(weights: Path, metadata: Mapping[str, Any], history: Mapping[str, Any], count: int) -> str:
    training = history.get("training", {})
    averaged = training.get("average_steps")
    facts = (
        f"{count:,} numbers in {weights.stat().st_size / 1e6:.2f} MB (safetensors, half precision)",
        f"the best of the run's validations, after {history.get('step')} of {training.get('num_steps')} steps of "
        f"{training.get('batch_size')} examples and {history.get('seconds')} s",
        f"seed {training.get('seed')}, warm-up {training.get('warmup_steps')} steps, "
        f"precision {training.get('precision')}",
        *([f"a running mean of the weights over {averaged} steps"] if averaged else []),
    )
    return _listed(facts)


def _dataset(table: Mapping[str, Any]) -> str:
    said = ", ".join(f"{key} {value}" for key, value in table.items() if key not in ("name", "split_hash"))
    tail = f"; SHA-256 of its ranges `{table['split_hash']}`" if "split_hash" in table else ""
    return f"`{table.get('name')}`: {said}{tail}"


def _numbers(scores: Mapping[str, float]) -> list[str]:
    return [f"{name}: {value:.4g}" for name, value in scores.items()]


def _listed(items: Iterable[str]) -> str:
    return "\n".join(f"- {item}" for item in items)


def _mean(values: Iterable[float]) -> str:
    held = list(values)
    return f"{sum(held) / len(held):.4g}" if held else "-"
