"""Curves over the horizon or over samples, one line per method, with 95 % intervals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from geovp_benchmarks.analysis import intervals
from geovp_benchmarks.plots import style
from geovp_benchmarks.results.score_names import Bounds
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Curve:
    """The mean score of a method per step."""

    label: str
    mean: FloatArray  # [F]
    low: FloatArray  # [F], ends of the intervals; the mean where there is none
    high: FloatArray
    num_clips: int  # that have a value
    has_intervals: bool
    line: style.LineStyle

    @classmethod
    def of(
        cls,
        label: str,
        values: FloatArray,  # [N, F]
        clips: Sequence[str],
        bounds: Bounds,
        line: style.LineStyle,
    ) -> Self:
        """Average values over clips, with the intervals of tables at all steps."""
        sequences = intervals.sequences_of(clips)
        steps = [intervals.interval(step, sequences, bounds=bounds) for step in values.T]
        mean, low, high = np.array([(step.mean, step.low, step.high) for step in steps]).T
        has_interval = np.isfinite(low)
        num_clips = int(np.isfinite(values).sum(axis=0).max())
        low, high = np.where(has_interval, low, mean), np.where(has_interval, high, mean)
        return cls(label, mean, low, high, num_clips, bool(has_interval.any()), line)

    @property
    def steps(self) -> FloatArray:
        """Return the steps [F], 1..F."""
        return np.arange(1.0, len(self.mean) + 1)

    def without_intervals(self) -> Self:
        """Return the curve of the means alone."""
        return replace(self, low=self.mean, high=self.mean, has_intervals=False)

    def equals(self, other: "Curve") -> bool:
        """Return whether the two lines would cover each other."""
        return self.mean.shape == other.mean.shape and np.allclose(
            self.mean, other.mean, rtol=2e-3, equal_nan=True
        )


@dataclass(frozen=True)
class AxisLabels:
    """Labels of both axes."""

    title: str
    unit: str
    higher_is_better: bool | None
    step_s: float | None  # seconds between two horizon steps, None where clips differ
    x_label: str = "horizon (frames)"


def draw(
    curves: Sequence[Curve],
    labels: AxisLabels,
    heading: style.Heading,
    layout: style.Layout,
    grey: Sequence[Curve] = (),
    max_bands: int = 3,
) -> Figure:
    """Draw the curves with a legend; grey curves give all strata the same axes.

    Up to `max_bands` curves have bands; more curves have bars at two steps, beside one another.
    """
    figure, axes = layout.single_axes((4.8, 3.1), heading)
    for curve in grey:
        axes.plot(curve.steps, curve.mean, color=style.RULE, linewidth=0.8, zorder=1.5)
    lines = []
    for number, curve in enumerate(curves):
        if len(curves) <= max_bands:
            colour = curve.line.colour
            axes.fill_between(curve.steps, curve.low, curve.high, color=colour, alpha=0.12, lw=0)
        elif curve.has_intervals:
            _add_bars(axes, curve, number - (len(curves) - 1) / 2)
        num_below = sum(curve.equals(other) for other in curves[number + 1 :])
        spacing = max(1, len(curve.steps) // 4)
        width = 1.3 + 1.3 * num_below  # equal lines that are drawn later are thinner
        marks = (number % spacing, spacing)
        lines += axes.plot(curve.steps, curve.mean, **curve.line.kwargs(width), markevery=marks)
    _set_axes(axes, [*curves, *grey], labels)
    layout.add_legend(figure, lines, [curve.label for curve in curves])
    return figure


def _add_bars(axes: Axes, curve: Curve, place: float) -> None:
    """Add bars in the middle and at the end of the horizon, moved sideways by a place."""
    last = len(curve.steps) - 1
    at = sorted({last // 2, last})
    x = curve.steps[at] + place * len(curve.steps) / 100
    axes.vlines(x, curve.low[at], curve.high[at], color=curve.line.colour, lw=0.9, alpha=0.7)


def _set_axes(axes: Axes, curves: Sequence[Curve], labels: AxisLabels) -> None:
    last = max(float(curve.steps[-1]) for curve in curves)
    axes.set_xlim(0.5, last * 1.06 + 0.5)
    spacing = 10 if last > 50 else 5 if last >= 5 else 1
    ticks = [1.0, *np.arange(spacing, last + 1, spacing)] if spacing > 1 else curves[0].steps
    axes.set_xticks(ticks)
    axes.set_xlabel(labels.x_label)
    if labels.step_s is not None:
        axes.set_xlabel("horizon (frames; seconds)")
        axes.set_xticklabels([f"{step:.0f}\n{step * labels.step_s:.1f} s" for step in ticks])
    arrows = {True: "    ↑ higher is better", False: "    ↓ lower is better", None: ""}
    unit = f" ({labels.unit})" if labels.unit else ""
    axes.set_ylabel(f"{labels.title}{unit}{arrows[labels.higher_is_better]}")
    low = min(float(np.nanmin(curve.low)) for curve in curves)
    high = max(float(np.nanmax(curve.high)) for curve in curves)
    margin = 0.05 * (high - low) or 0.5
    is_positive = all(np.nanmin(curve.mean) >= 0 for curve in curves)
    axes.set_ylim(max(low - margin, 0.0) if is_positive else low - margin, high + margin)
    axes.yaxis.set_major_locator(MaxNLocator(6))
