"""Curves over the horizon, and over the number of samples, from stored scores."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.plots import curves, style
from geovp_benchmarks.plots.material import Material, Page, page, title
from geovp_benchmarks.results.store import Method
from geovp_benchmarks.results.stored_facts import bounds, higher_is_better


@dataclass(frozen=True)
class Line:
    """The scores that one curve shows."""

    label: str
    key: tuple[str, str]  # decides the style: pose source and renderer
    method: Method
    reduce: statistics.Reduction


def metrics(material: Material) -> list[str]:
    """Return the metrics with a unit that have values at several steps.

    They have the order of the protocol; metrics over sets of pixels come last.
    """
    steps: dict[str, set[int]] = {}
    for scores in material.scores.values():
        for metric, values in scores.values.items():
            finite = np.flatnonzero(np.isfinite(values).any(axis=(0, 1)))
            steps.setdefault(metric, set()).update(finite.tolist())
    facts = material.protocol["metrics"]
    min_steps = min(2, material.protocol["num_future"])
    names = []
    for name, about in facts.items():
        if "unit" in about:
            names += [key for key in steps if key.partition("@")[0] == name]
    names = [name for name in names if len(steps[name]) >= min_steps]
    return sorted(names, key=lambda name: "@" in name)


def pages(material: Material, metric: str, layout: style.Layout) -> list[Page]:
    """Draw one metric over the horizon; over sets of pixels as svg only."""
    lines = _curves(material, metric)
    shown = _limited(lines, material, metric, layout)
    subtitle = _subtitle(material, shown, len(lines))
    heading = style.Heading(f"{title(metric)} over horizon", subtitle)
    figure = curves.draw(shown, _labels(material, metric), heading, layout)
    formats = ("svg",) if "@" in metric else ("png", "svg")
    return [page("horizon", metric, metric, heading, figure, formats)]


def stratum_pages(
    strata: Mapping[str, Material], by: str, metric: str, layout: style.Layout
) -> list[Page]:
    """Draw one figure per stratum, with the curves of the other strata in grey."""
    shown = {}
    for label, material in strata.items():
        lines = _limited(_curves(material, metric), material, metric, layout)
        if lines:
            shown[label] = lines
    drawn = []
    for number, (label, lines) in enumerate(shown.items(), 1):
        material = strata[label]
        subtitle = _subtitle(material, lines, len(lines)) + ", grey: other clips"
        heading = style.Heading(f"{title(metric)} over horizon: {label}", subtitle)
        grey = [line for other, rest in shown.items() if other != label for line in rest]
        labels = replace(_labels(material, metric), step_s=next(iter(strata.values())).step_s)
        figure = curves.draw(lines, labels, heading, layout, grey)
        drawn.append(page("strata", f"{by}-{number}-{metric}", metric, heading, figure))
    return drawn


def sample_pages(material: Material, metric: str, layout: style.Layout) -> list[Page]:
    """Draw the expected best score of k samples over k, where it is defined."""
    facts = material.protocol["metrics"][metric]
    higher = higher_is_better(metric, facts)
    if higher is None:
        return []
    scores = {}
    for method in material.methods:
        values = material.values(method, metric)
        if values.shape[1] > 1 and np.isfinite(values).any():
            scores[method.label] = values
    styles = style.line_styles([(label, "") for label in scores])
    shown = []
    for (label, values), line in zip(scores.items(), styles, strict=True):
        best = statistics.expected_best(values, higher)
        clips = material.protocol["clips"]
        shown.append(curves.Curve.of(label, best, clips, bounds(metric, facts), line))
    if not shown:
        return []
    shown = _limited(shown, material, metric, layout)
    labels = replace(_labels(material, metric), step_s=None, x_label="number of samples k")
    subtitle = f"{material.data}: selected by the real future; mean over sets of k and over clips"
    heading = style.Heading(f"{title(metric)} of the best of k samples", subtitle)
    return [page("samples", metric, metric, heading, curves.draw(shown, labels, heading, layout))]


def _curves(material: Material, metric: str) -> list[curves.Curve]:
    """Return one curve per line that has values; a label says where clips are missing."""
    facts = material.protocol["metrics"][metric.partition("@")[0]]
    higher = higher_is_better(metric, facts)
    lines = _lines(material.methods, is_trajectory=facts["role"] == "trajectory")
    shown = []
    for line, look in zip(lines, style.line_styles([line.key for line in lines]), strict=True):
        samples = material.values(line.method, metric)
        is_defined = higher is not None or line.reduce is not statistics.best_of_samples
        if is_defined and np.isfinite(samples).any():
            values, clips = line.reduce(samples, higher), material.protocol["clips"]
            ends = bounds(metric, facts)
            shown.append(curves.Curve.of(line.label, values, clips, ends, look))
    most = max((curve.num_clips for curve in shown), default=0)
    for number, curve in enumerate(shown):
        if curve.num_clips < most:
            label = f"{curve.label} (only {curve.num_clips} of {most} clips)"
            shown[number] = replace(curve, label=label)
    return shown


def _limited(
    shown: list[curves.Curve], material: Material, metric: str, layout: style.Layout
) -> list[curves.Curve]:
    """Return the best curves, at most as many as can be told apart, in their order.

    Many curves have no intervals.
    """
    if len(shown) > layout.max_intervals:
        shown = [curve.without_intervals() for curve in shown]
    if len(shown) <= layout.max_lines:
        return shown
    facts = material.protocol["metrics"][metric.partition("@")[0]]
    sign = {True: -1.0, False: 1.0, None: 0.0}[higher_is_better(metric, facts)]
    ranked = sorted(shown, key=lambda curve: sign * float(np.nanmean(curve.mean)))
    best = {curve.label for curve in ranked[: layout.max_lines]}
    return [curve for curve in shown if curve.label in best]


def _subtitle(material: Material, shown: Sequence[curves.Curve], num_lines: int) -> str:
    """Say what the curves are means over, and which lines are missing."""
    most = max(curve.num_clips for curve in shown)
    words = f"{material.data}: mean of {most} clip{'s' * (most != 1)}"
    if any(curve.has_intervals for curve in shown):
        words += ", with 95 % intervals (block bootstrap)"
    if len(shown) < num_lines:
        words += f"; the best {len(shown)} of {num_lines} lines (--methods selects others)"
    return words


def _labels(material: Material, metric: str) -> curves.AxisLabels:
    facts = material.protocol["metrics"][metric.partition("@")[0]]
    higher = higher_is_better(metric, facts)
    return curves.AxisLabels(title(metric), facts["unit"], higher, material.step_s)


def _lines(methods: Sequence[Method], *, is_trajectory: bool) -> list[Line]:
    """Return a line per method, or per pose source; with several samples their mean and best.

    Styles do not depend on which lines have values, so that all figures agree.
    """
    lines: dict[tuple[str, str], Line] = {}
    for method in methods:
        first, second, label = (
            method.pose_source or method.label,
            method.renderer or "",
            method.label,
        )
        if is_trajectory:
            second, label = "", first
        count = method.num_samples
        reductions: dict[str, statistics.Reduction] = {"": statistics.mean_of_samples}
        if count > 1:
            reductions = {
                f", mean of {count}": statistics.mean_of_samples,
                f", best of {count}": statistics.best_of_samples,
            }
        for suffix, reduce in reductions.items():
            key = (first, second + suffix)
            lines.setdefault(key, Line(label + suffix, key, method, reduce))
    return list(lines.values())
