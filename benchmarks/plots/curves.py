"""Metric over horizon: one line per method, its standard error as a band, its name at its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from benchmarks.plots import style
from geovp_classic.types import FloatArray

MOST_LINES = 12
WIDTH_IN, HEIGHT_IN = 4.6, 3.1  # of the axes; names stand outside
OUTLIER_RATIO = 3.0  # to the second largest
NAMES_FROM = 1.12  # in widths of the axes
NAME_PT, NAME_GAP_PT = 7.5, 9.5


@dataclass(frozen=True)
class Curve:
    """A method's mean score per horizon step."""

    label: str
    steps: FloatArray  # [K], 1..F
    mean: FloatArray  # [K]
    error: FloatArray  # [K], half the band's height; NaN where unknown
    stroke: style.Stroke


@dataclass(frozen=True)
class Measure:
    """What the vertical axis says."""

    title: str
    unit: str
    higher_is_better: bool
    step_s: float | None  # seconds from one horizon step to the next, None where clips differ
    across: str = "horizon (frames)"


def draw(curves: Sequence[Curve], measure: Measure, words: style.Words) -> list[Figure]:
    """One figure per dozen curves; those of the other pages stay as faint lines, and all pages share their axes."""
    pages = style.pages(len(curves), MOST_LINES)
    return [_page(curves, measure, page, words.numbered(n, len(pages))) for n, page in enumerate(pages, 1)]


def _page(curves: Sequence[Curve], measure: Measure, page: range, words: style.Words) -> Figure:
    named = [curves[number] for number in page]
    highest = _limits(curves, measure)[1]
    names = [_name(curve, highest, measure.unit) for curve in named]
    names_in = (NAMES_FROM - 1) * WIDTH_IN + style.width_in(names, NAME_PT) + 0.1
    figure, axes = style.sheet((WIDTH_IN, HEIGHT_IN), style.Margins(right_in=names_in), words)
    style.tidy(axes)
    for number, curve in enumerate(curves):
        if number in page:
            _line(axes, curve)
        else:
            axes.plot(curve.steps, curve.mean, color=style.RULE, linewidth=0.8, zorder=1.5)
    _frame(axes, curves, measure)
    _names(axes, named, names)
    return figure


def _line(axes: Axes, curve: Curve) -> None:
    stroke = curve.stroke
    low, high = curve.mean - curve.error, curve.mean + curve.error
    axes.fill_between(curve.steps, low, high, color=stroke.colour, alpha=0.16, linewidth=0)
    every = [i for i, step in enumerate(curve.steps) if step == 1 or step % 5 == 0]
    axes.plot(curve.steps, curve.mean, **stroke.line(), markevery=every)


def _frame(axes: Axes, curves: Sequence[Curve], measure: Measure) -> None:
    last = max(float(curve.steps[-1]) for curve in curves)
    apart = 5 if last <= 50 else 10
    ticks = [1.0, *np.arange(apart, last + 1, apart)] if last >= 5 else list(np.arange(1, last + 1))
    axes.set_xlim(0.5, last * 1.02 + 0.5)
    axes.set_xticks(ticks)
    axes.set_xlabel(measure.across if measure.step_s is None else "horizon (frames; seconds)", color=style.INK)
    if measure.step_s is not None:
        axes.set_xticklabels([f"{step:.0f}\n{step * measure.step_s:.1f} s" for step in ticks])
    arrow = "↑ higher is better" if measure.higher_is_better else "↓ lower is better"
    unit = f" ({measure.unit})" if measure.unit else ""
    axes.set_ylabel(f"{measure.title}{unit}    {arrow}", color=style.INK)
    axes.set_ylim(*_limits(curves, measure))
    axes.yaxis.set_major_locator(MaxNLocator(6))


def _limits(curves: Sequence[Curve], measure: Measure) -> tuple[float, float]:
    """The range of all bands with a margin; does not leave zero behind when no value does.

    An error far larger than all others runs off the axis, so that these can be distinguished; its name has the value.
    """
    errors = [np.nan_to_num(curve.error) for curve in curves]
    low = min(np.nanmin(curve.mean - error) for curve, error in zip(curves, errors, strict=True))
    highs = sorted(np.nanmax(curve.mean + error) for curve, error in zip(curves, errors, strict=True))
    is_outlier = not measure.higher_is_better and len(highs) > 2 and highs[-1] > OUTLIER_RATIO * highs[-2] > 0
    high = highs[-2] if is_outlier else highs[-1]
    margin = 0.05 * (high - low) or 0.5
    floor = 0.0 if min(np.nanmin(curve.mean) for curve in curves) >= 0 else -np.inf
    return max(float(low - margin), floor), float(high + margin)


def _names(axes: Axes, curves: Sequence[Curve], names: Sequence[str]) -> None:
    """Names beside the ends of their lines, with a sample of the line, moved apart where lines end together."""
    ends = [_end(curve) for curve in curves]
    low, high = axes.get_ylim()
    desired = [(min(value, high) - low) / (high - low) for _, value in ends]
    gap, edge = NAME_GAP_PT / 72 / HEIGHT_IN, 3 / 72 / HEIGHT_IN
    heights = style.spread(desired, gap, edge, 1 - edge)
    leader = {"arrowstyle": "-", "color": style.FAINT, "linewidth": 0.5, "shrinkA": 0, "shrinkB": 3}
    for curve, name, end, height in zip(curves, names, ends, heights, strict=True):
        if end[1] <= high:
            axes.annotate("", end, (1.03, height), textcoords="axes fraction", annotation_clip=False, arrowprops=leader)
        sample = (1.035, 1.07, 1.105)
        axes.plot(sample, [height] * 3, transform=axes.transAxes, clip_on=False, **curve.stroke.line(), markevery=[1])
        axes.text(NAMES_FROM, height, name, transform=axes.transAxes, va="center", fontsize=NAME_PT, color=style.INK)


def _name(curve: Curve, highest: float, unit: str) -> str:
    """The label, and where the line goes when it leaves the axes."""
    value = _end(curve)[1]
    return curve.label if value <= highest else f"{curve.label} (off the axis: {f'{value:#.3g} {unit}'.strip()})"


def _end(curve: Curve) -> tuple[float, float]:
    """The last point with a value."""
    last = int(np.flatnonzero(np.isfinite(curve.mean))[-1])
    return float(curve.steps[last]), float(curve.mean[last])
