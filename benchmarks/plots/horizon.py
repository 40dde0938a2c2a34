"""Curves over the horizon, and over the number of samples to choose from, from stored rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow.compute as pc

from benchmarks import statistics
from benchmarks.plots import curves, style
from benchmarks.plots.material import Material, Page, numbered, title
from benchmarks.store import Cell


@dataclass(frozen=True)
class _Line:
    """One curve of every figure over horizon."""

    label: str
    cell: Cell
    reduce: statistics.Reduction
    stroke: style.Stroke


def metrics(material: Material) -> list[str]:
    """The metrics that have values at several steps (or at all, where there is but one), in the protocol's order.

    Metrics of a pixel set come last; a metric that the protocol cannot explain is left out.
    """
    known: dict[str, set[int]] = {}
    for rows in material.rows.values():
        rows = rows.filter(pc.is_valid(rows["value"])).group_by(["metric", "step"]).aggregate([])
        for metric, step in zip(rows["metric"].to_pylist(), rows["step"].to_pylist(), strict=True):
            known.setdefault(metric, set()).add(step)
    explained = [name for name, about in material.protocol["metrics"].items() if "unit" in about]
    enough = min(2, material.protocol["num_future"])
    found = [metric for metric, steps in known.items() if len(steps) >= enough]
    found = [metric for metric in found if metric.partition("@")[0] in explained]
    return sorted(found, key=lambda metric: ("@" in metric, explained.index(metric.partition("@")[0])))


def pages(material: Material, metric: str) -> list[Page]:
    """The figures of one metric; over sets of pixels, which are many, as svg alone."""
    facts = material.protocol["metrics"][metric.partition("@")[0]]
    known = []
    for line in _lines(material.cells, facts["role"]):
        cube = statistics.cube(material.rows[line.cell.name], metric)
        if np.isfinite(cube.values).any():
            known.append((line, statistics.over_clips(line.reduce(cube, facts["higher_is_better"]))))
    most = max(int(estimate.count.max()) for _, estimate in known)
    over = f"{material.data}: mean of {most} clip{'s' * (most != 1)}"
    over += ", band ± one standard error over clips" if most > 1 else ""
    words = style.Words(f"{title(metric)} over horizon", over)
    measure = curves.Measure(title(metric), facts["unit"], facts["higher_is_better"], material.step_s)
    figures = curves.draw([_curve(line, estimate, most) for line, estimate in known], measure, words)
    drawn = numbered("horizon", metric, metric, words, figures)
    return [replace(page, formats=("svg",)) for page in drawn] if "@" in metric else drawn


def sample_pages(material: Material, metric: str) -> list[Page]:
    """What the best of k samples scores on average, over k; none where no cell has several samples."""
    facts = material.protocol["metrics"][metric]
    found = []
    for cell in (cell for cell in material.cells if cell.num_samples > 1):
        cube = statistics.cube(material.rows[cell.name], metric)
        if cube.values.shape[1] > 1 and np.isfinite(cube.values).any():
            found.append((cell.label, statistics.over_clips(statistics.expected_best(cube, facts["higher_is_better"]))))
    if not found:
        return []
    strokes = style.strokes([(label, "") for label, _ in found])
    lines = [
        curves.Curve(label, np.arange(1.0, len(best.mean) + 1), best.mean, best.error, stroke)
        for (label, best), stroke in zip(found, strokes, strict=True)
    ]
    measure = curves.Measure(title(metric), facts["unit"], facts["higher_is_better"], None, "samples to choose from")
    words = style.Words(
        f"{title(metric)} of the best of k samples",
        f"{material.data}: chosen by the real future; mean over sets of k and over clips, band ± one standard error",
    )
    return numbered("samples", metric, metric, words, curves.draw(lines, measure, words))


def _curve(line: _Line, estimate: statistics.Estimate, most: int) -> curves.Curve:
    count = int(estimate.count.max())
    label = line.label if count == most else f"{line.label} (only {count} of {most} clips)"
    return curves.Curve(label, np.arange(1.0, len(estimate.mean) + 1), estimate.mean, estimate.error, line.stroke)


def _lines(cells: Sequence[Cell], role: str) -> list[_Line]:
    """One line per cell, or per pose source where the metric does not see the renderer; two where there are samples.

    Colours and dashes do not depend on which of the lines have values, so that all figures agree.
    """
    found: dict[tuple[str, str], tuple[str, Cell, statistics.Reduction]] = {}
    for cell in cells:
        first, second = cell.pose_source or cell.label, cell.renderer or ""
        label = cell.label
        if role == "trajectory":
            label, second = first, ""
        count = cell.num_samples
        mean = label if count == 1 else f"{label}, mean of {count}"
        found.setdefault((first, second), (mean, cell, statistics.mean_of_samples))
        if count > 1:
            best = (f"{label}, best of {count}", cell, statistics.best_of_samples)
            found.setdefault((first, f"{second}, best"), best)
    strokes = style.strokes(list(found))
    return [_Line(*facts, stroke) for facts, stroke in zip(found.values(), strokes, strict=True)]
