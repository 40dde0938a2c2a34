"""Curves over the horizon, and over the number of samples to choose from, from stored rows."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.plots import curves, style
from geovp_benchmarks.plots.material import Material, Page, numbered, title
from geovp_benchmarks.results.store import Cell
from geovp_benchmarks.results.stored_facts import bounds, higher_is_better

_Line = tuple[
    str, Cell, statistics.Reduction, style.LineStyle
]  # one curve of every figure over horizon


def metrics(material: Material) -> list[str]:
    """The metrics that have values at several steps (or at all, where there is but one), in the
    protocol's order.

    Metrics of a pixel set come last; a metric without a unit in the protocol is left out.
    """
    known: dict[str, set[int]] = {}
    for rows in material.rows.values():
        for metric in rows.metric.categories:
            steps = rows.where(rows.metric.among((metric,)) & ~np.isnan(rows.value)).step
            known.setdefault(metric, set()).update(steps.tolist())
    explained = [name for name, about in material.protocol["metrics"].items() if "unit" in about]
    enough = min(2, material.protocol["num_future"])
    found = [metric for metric, steps in known.items() if len(steps) >= enough]
    found = [metric for metric in found if metric.partition("@")[0] in explained]
    return sorted(
        found, key=lambda metric: ("@" in metric, explained.index(metric.partition("@")[0]))
    )


def pages(material: Material, metric: str) -> list[Page]:
    """The figures of one metric; over sets of pixels, which are many, as svg alone."""
    shown = _curves(material, metric)
    heading = style.Heading(f"{title(metric)} over horizon", _over(material, shown))
    formats = ("svg",) if "@" in metric else ("png", "svg")
    return numbered(
        "horizon",
        metric,
        metric,
        heading,
        curves.draw(shown, _labels(material, metric), heading),
        formats,
    )


def stratum_pages(parts: Mapping[str, Material], by: str, metric: str) -> list[Page]:
    """One figure per stratum with the curves of all strata behind its own, so that all have the
    same axes.
    """
    found = {label: (material, _curves(material, metric)) for label, material in parts.items()}
    found = {label: (material, shown) for label, (material, shown) in found.items() if shown}
    headings = [
        style.Heading(f"{title(metric)} over horizon: {label}", _over(*own) + ", grey: other clips")
        for label, own in found.items()
    ]
    labels = _labels(next(iter(parts.values())), metric)
    figures = curves.draw_groups([shown for _, shown in found.values()], labels, headings)
    return [
        page
        for number, (heading, figure) in enumerate(zip(headings, figures, strict=True), 1)
        for page in numbered("strata", f"{by}-{number}-{metric}", metric, heading, [figure])
    ]


def _curves(material: Material, metric: str) -> list[curves.Curve]:
    """One curve per line that has values; those of fewer clips than the others say so."""
    facts = material.protocol["metrics"][metric.partition("@")[0]]
    higher, shown = higher_is_better(metric, facts), []
    for label, cell, reduce, line in _lines(material.cells, facts["role"]):
        cube = statistics.cube(material.rows[cell.name], metric)
        has_best = higher is not None or reduce is not statistics.best_of_samples
        if has_best and np.isfinite(cube.values).any():
            shown.append(
                curves.Curve.of(
                    label, reduce(cube, higher), cube.clips, bounds(metric, facts), line
                )
            )
    most = max((curve.num_clips for curve in shown), default=0)
    for number, curve in enumerate(shown):
        if curve.num_clips < most:
            shown[number] = replace(
                curve, label=f"{curve.label} (only {curve.num_clips} of {most} clips)"
            )
    return shown


def _over(material: Material, shown: Sequence[curves.Curve]) -> str:
    """What the curves are means over."""
    most = max(curve.num_clips for curve in shown)
    return f"{material.data}: mean of {most} clip{'s' * (most != 1)}{_intervals(shown)}"


def _intervals(shown: Sequence[curves.Curve]) -> str:
    """How the curves' intervals are drawn, if there are any."""
    words = (
        f", {'bands' if len(shown) <= curves.MOST_BANDS else 'bars'}: 95 % intervals (block "
        "bootstrap)"
    )
    return words * any(np.isfinite(curve.low).any() for curve in shown)


def _labels(material: Material, metric: str) -> curves.AxisLabels:
    facts = material.protocol["metrics"][metric.partition("@")[0]]
    return curves.AxisLabels(
        title(metric), facts["unit"], higher_is_better(metric, facts), material.step_s
    )


def sample_pages(material: Material, metric: str) -> list[Page]:
    """The expected best score of k samples, over k; none where no cell has several, or no score is
    the better one.
    """
    facts = material.protocol["metrics"][metric]
    higher, found = higher_is_better(metric, facts), []
    if higher is None:
        return []
    for cell in (cell for cell in material.cells if cell.num_samples > 1):
        cube = statistics.cube(material.rows[cell.name], metric)
        if cube.values.shape[1] > 1 and np.isfinite(cube.values).any():
            found.append((cell.label, cube.clips, statistics.expected_best(cube, higher)))
    if not found:
        return []
    styles, ends = style.line_styles([(label, "") for label, *_ in found]), bounds(metric, facts)
    shown = [
        curves.Curve.of(label, best, clips, ends, line)
        for (label, clips, best), line in zip(found, styles, strict=True)
    ]
    labels = replace(_labels(material, metric), step_s=None, x_label="samples to choose from")
    heading = style.Heading(
        f"{title(metric)} of the best of k samples",
        f"{material.data}: selected by the real future; mean over sets of k and over "
        f"clips{_intervals(shown)}",
    )
    return numbered("samples", metric, metric, heading, curves.draw(shown, labels, heading))


def _lines(cells: Sequence[Cell], role: str) -> list[_Line]:
    """One line per cell, or per pose source for a trajectory metric; two (mean and best) where
    there are samples.

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
    styles = style.line_styles(list(found))
    return [(*facts, line) for facts, line in zip(found.values(), styles, strict=True)]
