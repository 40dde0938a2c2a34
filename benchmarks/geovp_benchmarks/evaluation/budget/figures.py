"""The error budget as waterfalls, from the forecast upwards and from the truth downwards; and
sensitivity curves.
"""

from collections.abc import Callable, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geovp_benchmarks.evaluation.budget.offsets import EXACT, SHIFTS, SIZES, TURNS, Offset
from geovp_benchmarks.evaluation.budget.scores import Scores, Subject, heading
from geovp_benchmarks.evaluation.budget.stages import DIRECTIONS, NONE, Budget
from geovp_benchmarks.plots import style
from geovp_benchmarks.plots.material import Page

PANEL_IN, ROW_IN, OFFSETS_IN = 2.5, 0.24, (3.6, 2.6)
BETTER, WORSE = style.COLOURS[0], style.COLOURS[1]
TITLES = (
    "put in alone\n(forecast upwards)",
    "put in one by one\n(from top to bottom)",
    "taken away alone\n(truth downwards)",
)


def pages(budget: Budget) -> list[Page]:
    """One figure a metric: three panels that share their axes, a bar a stage from the score before
    to that after.
    """
    return _pages(
        "budget", budget.scores.subject, "Error budget", lambda metric: _draw_budget(budget, metric)
    )


def sensitivity_pages(scores: Scores[Offset]) -> list[Page]:
    """One figure a metric: the score over the size of a constant error of the pose, turns and
    shifts apart.
    """
    return _pages(
        "sensitivity",
        scores.subject,
        "Cost of pose errors",
        lambda metric: _draw_offsets(scores, metric),
    )


def _pages(kind: str, subject: Subject, title: str, draw: Callable[[str], Figure]) -> list[Page]:
    caption = f"{title}: {subject.label}"
    with matplotlib.style.context(style.SHEET):
        figures = {metric: draw(metric) for metric in subject.metrics}
        for figure in figures.values():
            figure.text(0, 1 + 0.78 / figure.get_figheight(), caption, fontsize=9.5, weight="bold")
    return [
        Page(f"{kind}-{metric}", kind, metric, caption, figure, ("png", "svg"))
        for metric, figure in figures.items()
    ]


def _panels(count: int, size_in: tuple[float, float], about: str) -> tuple[Figure, list[Axes]]:
    """A figure of axes side by side, each of that size, that share the vertical one; with words
    above.
    """
    figure = Figure(figsize=(count * size_in[0], size_in[1]), dpi=style.PRINT_DPI)
    panels = figure.subplots(1, count, sharey=True, gridspec_kw={"wspace": 0.06})
    figure.subplots_adjust(left=0, right=1, bottom=0, top=1)
    figure.text(0, 1 + 0.46 / size_in[1], about, fontsize=7.5, color=style.FAINT)
    for axes in panels[1:]:
        axes.tick_params(left=False)
    return figure, list(panels)


def _draw_budget(budget: Budget, metric: str) -> Figure:
    subject = budget.scores.subject
    missing = f"; not measurable here: {', '.join(budget.missing)}" if budget.missing else ""
    whiskers = "\nwhiskers: 95 % intervals of the change" * budget.scores.have_intervals
    about = f"{subject.about}{whiskers}{missing}"
    figure, panels = _panels(3, (PANEL_IN, ROW_IN * (len(budget.stages) + 1)), about)
    levels = [budget.scores.level(variant, metric).mean for variant in budget.scores.values]
    low, high = np.nanmin(levels), np.nanmax(levels)
    for axes, direction, title in zip(panels, DIRECTIONS, TITLES, strict=True):
        axes.set_xlim(low - 0.35 * (high - low), high + 0.75 * (high - low))
        _draw_panel(axes, budget, metric, direction)
        axes.set_title(title, fontsize=8, color=style.INK)
    panels[0].set_yticks(range(len(budget.stages)), budget.stages)
    panels[0].set_ylim(len(budget.stages) - 0.4, -1.3)
    panels[1].set_xlabel(heading(metric, subject.metrics[metric]) + ", mean over clips")
    return figure


def _draw_panel(axes: Axes, budget: Budget, metric: str, direction: str) -> None:
    """The bars of one direction; an arrowhead where a whisker reaches beyond the panel."""
    scores, measure = budget.scores, budget.scores.subject.metrics[metric]
    for label, variant, dash in (("forecast", NONE, ":"), ("truth", budget.everything, "--")):
        at = scores.level(variant, metric).mean
        axes.axvline(at, color=style.INK, linewidth=0.9, linestyle=dash)
        side = (
            "left" if (label == "truth") == measure.higher_is_better else "right"
        )  # of the words, at the line
        axes.text(at, -0.9, f" {label} ", ha=side, va="center", fontsize=6.5)
    left, right = axes.get_xlim()
    limits = left, right - 0.2 * (right - left)  # beyond them stand the numbers
    for row, stage in enumerate(budget.stages):
        start = scores.level(budget.pair(direction, stage)[0], metric).mean
        change = budget.change(direction, stage, metric)
        whisker = np.clip([start + change.low, start + change.high], limits[0], limits[1])
        better = (change.mean > 0) == measure.higher_is_better
        axes.barh(row, change.mean, left=start, height=0.62, color=BETTER if better else WORSE)
        axes.plot(whisker, [row, row], color=style.INK, linewidth=0.9)
        for end in (0, 1):
            if whisker[end] == limits[end]:
                axes.plot(
                    limits[end], row, "<>"[end], color=style.INK, markersize=3.5, clip_on=False
                )
        number: dict[str, Any] = {
            "xycoords": axes.get_yaxis_transform(),
            "ha": "right",
            "va": "center",
        }
        digits = 2 if measure.unit == "dB" else 3
        axes.annotate(f"{change.mean:+.{digits}f}", (0.98, row), **number, fontsize=6.5)
    axes.grid(axis="y", visible=False)


def _draw_offsets(scores: Scores[Offset], metric: str) -> Figure:
    subject, height_m = scores.subject, scores.subject.first.camera_height_m
    bands = "\nbands: 95 % intervals of the change" * scores.have_intervals
    figure, panels = _panels(2, OFFSETS_IN, f"{subject.about}{bands}")
    for axes, names in zip(panels, (TURNS, SHIFTS), strict=True):
        _draw_curves(axes, scores, metric, names)
    share = "" if height_m is None else f"; the camera is {height_m:g} m high"
    panels[0].set_xlabel("offset (degrees): yaw right, pitch up, roll clockwise")
    panels[1].set_xlabel(f"offset (m): x right, y down, z forward{share}")
    panels[0].set_ylabel(heading(metric, subject.metrics[metric]) + ", mean over clips")
    return figure


def _draw_curves(axes: Axes, scores: Scores[Offset], metric: str, names: Sequence[str]) -> None:
    """A line an axis of the camera; sizes stand evenly apart, whatever they are."""
    exact = scores.level(EXACT, metric).mean
    sizes = [*(-size for size in reversed(SIZES[names[0]])), 0.0, *SIZES[names[0]]]
    places = np.arange(len(sizes))
    for name, line in zip(names, style.line_styles([(name, "") for name in names]), strict=True):
        changes = [
            scores.change([Offset(name, size) if size else EXACT], EXACT, metric) for size in sizes
        ]
        low, high = (
            exact + np.array([getattr(one, end) for one in changes]) for end in ("low", "high")
        )
        axes.fill_between(places, low, high, color=line.colour, alpha=0.16, linewidth=0)
        axes.plot(places, [exact + one.mean for one in changes], label=name, **line.kwargs())
    axes.set_xticks(places, [f"{size:g}" for size in sizes])
    is_peak = scores.subject.metrics[metric].higher_is_better  # at the exact pose, in the middle
    axes.legend(loc="lower center" if is_peak else "upper center")
