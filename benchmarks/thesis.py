"""Table 4.1 of the thesis in its own layout: our rows, and the published ones in a separate block."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np

from benchmarks import statistics, tables
from benchmarks.formats import grid
from benchmarks.store import Cell, Results

METRICS = ("psnr", "ssim", "lpips")
PUBLISHED = "thesis-table-4-1.toml"
STOCHASTIC = ("svg", "srvp", "slamp")
GEOMETRIC = {"Ours": ("deepvo",), "GT 2D Pose": ("planar", "ground-truth"), "GT 3D Pose": ("ground-truth",)}
DECIMALS = 3


@dataclass(frozen=True)
class Line:
    """A model with its mean and standard error in each of METRICS; None where it has none."""

    name: str
    rank: int  # place in the thesis's order; rows that it does not have come last
    values: tuple[tuple[float, float] | None, ...]


def markdown(results: Results) -> str:
    """Both blocks, with notes."""
    protocol = results.protocol()
    lines = [_line(cell, results) for cell in results.cells() if cell.status in ("done", "partial")]
    in_thesis = sorted((line for line in lines if line.rank < len(_order())), key=lambda line: line.rank)
    others = [line for line in lines if line.rank == len(_order())]
    published = _published()
    parts = [
        f"## {protocol['name']}: measured here, in the layout of the thesis's table 4.1",
        _block([*in_thesis, *others]),
        f"- {tables.summary(protocol)}.",
        f"- {statistics.KIND}. Rows of several samples: the best of each column by itself, as in the thesis.",
        *_absences(results, in_thesis),
        "",
        "## Published, not measured here",
        _block([Line(row["name"], 0, tuple(tuple(row[metric]) for metric in METRICS)) for row in published["row"]]),
        f"- {published['source']}: {published['about']}.",
        "- Other test clips, other training data and metrics that are not defined there: compare orders, not digits.",
    ]
    return "\n".join(parts) + "\n"


def _line(cell: Cell, results: Results) -> Line:
    name = _name(cell)
    rows, values = results.scores(cell.name), []
    for metric in METRICS:
        cube = statistics.cube(rows, metric)
        higher = metric != "lpips"
        reduce = statistics.best_of_samples if cell.num_samples > 1 else statistics.mean_of_samples
        estimate = statistics.overall(reduce(cube, higher))
        values.append((float(estimate.mean), float(estimate.error)) if int(estimate.count) else None)
    marks = "".join(tables.MARKS[grant][0] for grant in cell.grants)
    order = _order()
    is_known = _family(name) in order
    shown = name if is_known or not marks else f"{name} [{marks}]"
    return Line(shown, order.index(_family(name)) if is_known else len(order), tuple(values))


def _name(cell: Cell) -> str:
    """The thesis's name of such a cell; the cell's own label where it has none."""
    parts = cell.components.get("predictor", cell.components)
    if parts.get("name") in STOCHASTIC:
        return f"{parts['name'].upper()} - {cell.num_samples} Sample{'s' * (cell.num_samples > 1)}"
    source = parts.get("pose_source", {})
    names = tuple(filter(None, (source.get("name"), source.get("source", {}).get("name"))))
    if parts.get("renderer", {}).get("name") == "synsin":
        for name, sources in GEOMETRIC.items():
            if names == sources:
                return name if name == "Ours" else f"{name} + SynSin"
    return cell.label


def _family(name: str) -> str:
    """The name with the number of samples reduced to one or many."""
    model, dash, count = name.partition(" - ")
    return f"{model}{dash}{'1' if count == '1 Sample' else 'many'}" if dash else name


def _order() -> list[str]:
    """The families in the thesis's order."""
    return [_family(str(row["name"])) for row in _published()["row"]]


def _published() -> Mapping[str, Any]:
    return tomllib.loads((resources.files("benchmarks") / "published" / PUBLISHED).read_text("utf-8"))


def _block(lines: Sequence[Line]) -> str:
    """The lines with the best of each column in bold, as the thesis prints them."""
    head = ["Models", "PSNR (↑)", "SSIM (↑)", "LPIPS (↓)"]
    best = []
    for i, metric in enumerate(METRICS):
        means = [round(value[0], DECIMALS) for line in lines if (value := line.values[i]) is not None]
        best.append((min if metric == "lpips" else max)(means, default=float("nan")))
    body = [[line.name, *(_text(v, b) for v, b in zip(line.values, best, strict=True))] for line in lines]
    return "\n".join(["", *grid([head, *body], numbers=False), ""])


def _text(value: tuple[float, float] | None, best: float) -> str:
    if value is None:
        return "-"
    mean = f"{value[0]:.{DECIMALS}f}"
    bold = f"**{mean}**" if round(value[0], DECIMALS) == best else mean
    return bold if np.isnan(value[1]) else f"{bold} ± {value[1]:.{DECIMALS}f}"


def _absences(results: Results, present: Sequence[Line]) -> list[str]:
    """The thesis's rows that are missing here, and cells that are not done."""
    here = {line.rank for line in present}
    names = [str(row["name"]) for rank, row in enumerate(_published()["row"]) if rank not in here]
    notes = [f"- Not in these results: {', '.join(names)}."] if names else []
    other = [cell for cell in results.cells() if cell.status != "done"]
    return notes + [f"- {cell.label}: {cell.status}: {cell.reason or 'run again'}." for cell in other]
