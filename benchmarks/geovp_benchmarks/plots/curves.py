"""Metric over horizon: one line per method with its 95 % intervals, as bands or, of many lines, as
bars; a legend.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from geovp_benchmarks.analysis import intervals
from geovp_benchmarks.plots import style
from geovp_classic.types import FloatArray

MOST_LINES = 12
SIZE_IN = (4.6, 3.1)  # of the axes
MOST_BANDS, BAR_SPACING = 3, 0.14  # lines with a band each; steps between the bars of more lines


@dataclass(frozen=True)
class Curve:
    """A method's mean score per horizon step."""

    label: str
    mean: FloatArray  # [F]
    low: FloatArray  # [F], ends of the intervals; NaN where there is none
    high: FloatArray
    num_clips: int  # how many have a value
    line: style.LineStyle

    @classmethod
    def of(
        cls,
        label: str,
        values: FloatArray,  # [N, F]
        clips: Sequence[str],
        bounds: intervals.Bounds,
        line: style.LineStyle,
    ) -> Self:
        """The curve of values of clips, with an interval at every step as tables have it."""
        sequences = intervals.sequences_of(clips)
        found = [intervals.interval(step, sequences, bounds=bounds) for step in values.T]
        mean, low, high = np.array([(one.mean, one.low, one.high) for one in found]).T
        return cls(label, mean, low, high, int(np.isfinite(values).sum(axis=0).max()), line)

    @property
    def steps(self) -> FloatArray:
        """The horizon [F], 1..F."""
        return np.arange(1.0, len(self.mean) + 1)

    @property
    def band(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bound [F]; the mean itself where there is no interval."""
        known = np.isfinite(self.low)
        return np.where(known, self.low, self.mean), np.where(known, self.high, self.mean)


@dataclass(frozen=True)
class AxisLabels:
    """Labels of both axes."""

    title: str
    unit: str
    higher_is_better: bool | None  # None: neither
    step_s: float | None  # seconds from one horizon step to the next, None where clips differ
    x_label: str = "horizon (frames)"


def draw(curves: Sequence[Curve], labels: AxisLabels, heading: style.Heading) -> list[Figure]:
    """One figure per dozen curves; those of the other pages stay as faint lines, and all pages
    share their axes.
    """
    if len(curves) > MOST_LINES:
        heading = replace(heading, subtitle=f"{heading.subtitle}, grey: other pages")
    return [
        _page(curves, labels, page, own)
        for page, own in style.pages(len(curves), MOST_LINES, heading)
    ]


def draw_groups(
    groups: Sequence[Sequence[Curve]], labels: AxisLabels, headings: Sequence[style.Heading]
) -> list[Figure]:
    """One figure per group of curves; those of the other groups are faint lines, and all figures
    share their axes.
    """
    every = [curve for group in groups for curve in group]
    ends = np.cumsum([len(group) for group in groups]).tolist()
    parts = [slice(end - len(group), end) for group, end in zip(groups, ends, strict=True)]
    return [
        _page(every, labels, part, heading) for part, heading in zip(parts, headings, strict=True)
    ]


def _page(
    curves: Sequence[Curve], labels: AxisLabels, page: slice, heading: style.Heading
) -> Figure:
    figure, axes = style.single_axes(SIZE_IN, heading)
    lines, names = [], []  # a label that begins with _ would be left out of the legend
    for number, curve in enumerate(curves):
        if not page.start <= number < page.stop:
            axes.plot(curve.steps, curve.mean, color=style.RULE, linewidth=0.8, zorder=1.5)
            continue
        every = [i for i, step in enumerate(curve.steps) if step == 1 or step % 5 == 0]
        if len(curves[page]) <= MOST_BANDS:
            axes.fill_between(
                curve.steps, *curve.band, color=curve.line.colour, alpha=0.1, linewidth=0
            )
        else:  # bands over one another cannot be told apart
            shift = BAR_SPACING * (number - page.start - (len(curves[page]) - 1) / 2)
            low, high = (bound[every] for bound in curve.band)
            axes.vlines(
                curve.steps[every] + shift,
                low,
                high,
                color=curve.line.colour,
                linewidth=0.8,
                alpha=0.6,
            )
        lines += axes.plot(curve.steps, curve.mean, **curve.line.kwargs(), markevery=every)
        names.append(curve.label)
    _set_axes(axes, curves, labels)
    axes.legend(lines, names, loc="center left", bbox_to_anchor=(1.02, 0.5))
    return figure


def _set_axes(axes: Axes, curves: Sequence[Curve], labels: AxisLabels) -> None:
    last = max(float(curve.steps[-1]) for curve in curves)
    apart = 5 if last <= 50 else 10
    ticks = [1.0, *np.arange(apart, last + 1, apart)] if last >= 5 else list(np.arange(1, last + 1))
    axes.set_xlim(0.5, last * 1.02 + 0.5)
    axes.set_xticks(ticks)
    axes.set_xlabel(labels.x_label if labels.step_s is None else "horizon (frames; seconds)")
    if labels.step_s is not None:
        axes.set_xticklabels([f"{step:.0f}\n{step * labels.step_s:.1f} s" for step in ticks])
    arrow = {True: "    ↑ higher is better", False: "    ↓ lower is better", None: ""}[
        labels.higher_is_better
    ]
    unit = f" ({labels.unit})" if labels.unit else ""
    axes.set_ylabel(f"{labels.title}{unit}{arrow}")
    axes.set_ylim(*_limits(curves))
    axes.yaxis.set_major_locator(MaxNLocator(6))


def _limits(curves: Sequence[Curve]) -> tuple[float, float]:
    """The range of all bands with a margin; at least 0 when no mean is negative."""
    low = min(np.nanmin(curve.band[0]) for curve in curves)
    high = max(np.nanmax(curve.band[1]) for curve in curves)
    margin = 0.05 * (high - low) or 0.5
    floor = 0.0 if min(np.nanmin(curve.mean) for curve in curves) >= 0 else -np.inf
    return max(float(low - margin), floor), float(high + margin)
