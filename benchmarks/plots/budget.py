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
    reached: list[float] = []
    for axes, direction, title in zip(panels, DIRECTIONS, TITLES, strict=True):
        reached += _draw_panel(axes, budget, metric, direction)
        axes.set_title(title, fontsize=8, color=style.INK)
        axes.tick_params(left=axes is panels[0])
    low, high = np.nanmin(reached), np.nanmax(reached)
    panels[0].set_xlim(low - 0.05 * (high - low), high + 0.32 * (high - low))  # the numbers stand on the right
    panels[0].set_yticks(range(len(budget.stages)), budget.stages)
    panels[0].set_ylim(len(budget.stages) - 0.4, -1.3)
    panels[1].set_xlabel(heading(metric, budget.subject.metrics[metric]) + ", mean over clips")
    missing = f"; not measurable here: {', '.join(budget.missing)}" if budget.missing else ""
    about = f"{budget.subject.about}\nwhiskers: 95 % intervals of the change{missing}"
    figure.text(0, 1 + 0.78 / size_in[1], f"Error budget of {budget.subject.label}", fontsize=9.5, weight="bold")
    figure.text(0, 1 + 0.46 / size_in[1], about, fontsize=7.5, color=style.FAINT)
    return figure


def _draw_panel(axes: Axes, budget: Budget, metric: str, direction: str) -> list[float]:
    """Draw the bars of one direction; all scores that they and their whiskers reach."""
    measure, digits = budget.subject.metrics[metric], 2 if budget.subject.metrics[metric].unit == "dB" else 3
    reached = []
    for label, variant, dash in (("forecast", NONE, ":"), ("truth", budget.everything, "--")):
        reached.append(budget.scores.level(variant, metric).mean)
        axes.axvline(reached[-1], color=style.INK, linewidth=0.9, linestyle=dash)
        axes.annotate(label, (reached[-1], -0.9), (2, 0), textcoords="offset points", va="center", fontsize=6.5)
    for row, stage in enumerate(budget.stages):
        start = budget.scores.level(budget.pair(direction, stage)[0], metric).mean
        change = budget.change(direction, stage, metric)
        ends = [start + change.low, start + change.high]
        better = (change.mean > 0) == measure.higher_is_better
        axes.barh(row, change.mean, left=start, height=0.62, color=BETTER if better else WORSE)
        axes.plot(ends, [row, row], color=style.INK, linewidth=0.9)
        number: dict[str, Any] = {"xycoords": axes.get_yaxis_transform(), "ha": "right", "va": "center"}
        axes.annotate(f"{change.mean:+.{digits}f}", (0.99, row), **number, fontsize=6.5)
        reached += [start, start + change.mean, *ends]
    axes.grid(axis="y", visible=False)
    return reached
