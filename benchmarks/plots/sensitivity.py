"""Sensitivity curves: a score over the size of a constant error of the pose, turns and shifts apart."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.plots import style
from benchmarks.plots.material import Page
from benchmarks.studies.budget.scores import heading
from benchmarks.studies.sensitivity import EXACT, SHIFTS, SIZES, TURNS, Offset, Sensitivity

PANEL_IN = (3.6, 2.6)


def pages(measured: Sensitivity) -> list[Page]:
    """One figure a metric."""
    caption = f"What errors of the future poses cost: {measured.subject.label}"
    with matplotlib.style.context(style.SHEET):
        return [
            Page(f"sensitivity-{name}", "sensitivity", name, caption, _draw(measured, name, caption), ("png", "svg"))
            for name in measured.subject.metrics
        ]


def _draw(measured: Sensitivity, metric: str, title: str) -> Figure:
    figure = Figure(figsize=(2 * PANEL_IN[0], PANEL_IN[1]), dpi=style.PRINT_DPI)
    panels = figure.subplots(1, 2, sharey=True, gridspec_kw={"wspace": 0.06})
    figure.subplots_adjust(left=0, right=1, bottom=0, top=1)
    _draw_axes(panels[0], measured, metric, TURNS)
    panels[0].set_xlabel("offset (degrees): yaw right, pitch up, roll clockwise")
    _draw_axes(panels[1], measured, metric, SHIFTS)
    height_m = measured.camera_height_m
    share = "" if height_m is None else f"; the camera is {height_m:g} m high"
    panels[1].set_xlabel(f"offset (m): x right, y down, z forward{share}")
    panels[0].set_ylabel(heading(metric, measured.subject.metrics[metric]) + ", mean over clips")
    about = f"{measured.subject.about}; bands: 95 % intervals of the change"
    figure.text(0, 1 + 0.30 / PANEL_IN[1], title, fontsize=9.5, weight="bold")
    figure.text(0, 1 + 0.12 / PANEL_IN[1], about, fontsize=7.5, color=style.FAINT)
    return figure


def _draw_axes(axes: Axes, measured: Sensitivity, metric: str, names: Sequence[str]) -> None:
    """A line an axis of the camera; sizes stand evenly apart, whatever they are."""
    scores, exact = measured.scores, measured.scores.level(EXACT, metric).mean
    sizes = [*(-size for size in reversed(SIZES[names[0]])), 0.0, *SIZES[names[0]]]
    places = np.arange(len(sizes))
    for name, line in zip(names, style.line_styles([(name, "") for name in names]), strict=True):
        changes = [scores.change([Offset(name, size) if size else EXACT], EXACT, metric) for size in sizes]
        low, high = (exact + np.array([getattr(one, end) for one in changes]) for end in ("low", "high"))
        axes.fill_between(places, low, high, color=line.colour, alpha=0.16, linewidth=0)
        axes.plot(places, [exact + one.mean for one in changes], label=name, **line.kwargs())
    axes.set_xticks(places, [f"{size:g}" for size in sizes])
    axes.legend(loc="upper right")
