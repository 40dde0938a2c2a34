"""The error budget as waterfalls: from the forecast upwards, in turn, and from the truth downwards."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.plots import style
from benchmarks.plots.material import Page
from benchmarks.studies.budget.scores import heading
from benchmarks.studies.budget.stages import DIRECTIONS, NONE, Budget

PANEL_IN, ROW_IN = 2.5, 0.24
BETTER, WORSE = style.COLOURS[0], style.COLOURS[1]
TITLES = (
    "put in alone\n(forecast upwards)",
    "put in one by one\n(from top to bottom)",
    "taken away alone\n(truth downwards)",
)


def pages(budget: Budget) -> list[Page]:
    """One figure a metric."""
    caption = f"Error budget of {budget.subject.label}"
    with matplotlib.style.context(style.SHEET):
        return [
            Page(f"budget-{name}", "budget", name, caption, draw(budget, name), ("png", "svg"))
            for name in budget.subject.metrics
        ]


def draw(budget: Budget, metric: str) -> Figure:
    """Three panels that share their axes: a bar a stage, from the score before to the score after."""
    size_in = (3 * PANEL_IN, ROW_IN * (len(budget.stages) + 1))
    figure = Figure(figsize=size_in, dpi=style.PRINT_DPI)
    panels = figure.subplots(1, 3, sharex=True, sharey=True, gridspec_kw={"wspace": 0.06})
    figure.subplots_adjust(left=0, right=1, bottom=0, top=1)
    levels = [budget.scores.level(variant, metric).mean for variant in budget.scores.values]
    low, high = np.nanmin(levels), np.nanmax(levels)
    panels[0].set_xlim(low - 0.35 * (high - low), high + 0.6 * (high - low))  # the numbers stand on the right
    for axes, direction, title in zip(panels, DIRECTIONS, TITLES, strict=True):
        _draw_panel(axes, budget, metric, direction)
        axes.set_title(title, fontsize=8, color=style.INK)
        axes.tick_params(left=axes is panels[0])
    panels[0].set_yticks(range(len(budget.stages)), budget.stages)
    panels[0].set_ylim(len(budget.stages) - 0.4, -1.3)
    panels[1].set_xlabel(heading(metric, budget.subject.metrics[metric]) + ", mean over clips")
    missing = f"; not measurable here: {', '.join(budget.missing)}" if budget.missing else ""
    about = f"{budget.subject.about}\nwhiskers: 95 % intervals of the change{missing}"
    figure.text(0, 1 + 0.78 / size_in[1], f"Error budget of {budget.subject.label}", fontsize=9.5, weight="bold")
    figure.text(0, 1 + 0.46 / size_in[1], about, fontsize=7.5, color=style.FAINT)
    return figure


def _draw_panel(axes: Axes, budget: Budget, metric: str, direction: str) -> None:
    """The bars of one direction; an arrowhead where a whisker reaches beyond the panel."""
    measure, digits = budget.subject.metrics[metric], 2 if budget.subject.metrics[metric].unit == "dB" else 3
    ends = {"forecast": (NONE, ":"), "truth": (budget.everything, "--")}
    for label, (variant, dash) in ends.items():
        at, side = (
            budget.scores.level(variant, metric).mean,
            1 if (label == "truth") == measure.higher_is_better else -1,
        )
        axes.axvline(at, color=style.INK, linewidth=0.9, linestyle=dash)
        place: dict[str, Any] = {"textcoords": "offset points", "ha": "left" if side > 0 else "right", "va": "center"}
        axes.annotate(label, (at, -0.9), (3 * side, 0), **place, fontsize=6.5)
    limits = axes.get_xlim()
    for row, stage in enumerate(budget.stages):
        start = budget.scores.level(budget.pair(direction, stage)[0], metric).mean
        change = budget.change(direction, stage, metric)
        whisker = np.clip([start + change.low, start + change.high], limits[0], limits[1])
        better = (change.mean > 0) == measure.higher_is_better
        axes.barh(row, change.mean, left=start, height=0.62, color=BETTER if better else WORSE)
        axes.plot(whisker, [row, row], color=style.INK, linewidth=0.9)
        for end in (0, 1):
            if whisker[end] == limits[end]:
                axes.plot(limits[end], row, "<>"[end], color=style.INK, markersize=3.5, clip_on=False)
        number: dict[str, Any] = {"xycoords": axes.get_yaxis_transform(), "ha": "right", "va": "center"}
        axes.annotate(f"{change.mean:+.{digits}f}", (0.98, row), **number, fontsize=6.5, backgroundcolor="white")
    axes.grid(axis="y", visible=False)
