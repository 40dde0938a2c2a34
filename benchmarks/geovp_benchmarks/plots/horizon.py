"""Figures of scores over the horizon: means of methods, by strata, and paired differences."""

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.style import context
from matplotlib.ticker import MaxNLocator

from geovp.drawing.page import SHEET, Page
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.plots.style import Options, line_styles
from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.score_names import FEATURES, UNBOUNDED, Bounds
from geovp_benchmarks.results.scores import nanmean
from geovp_benchmarks.results.store import Method
from geovp_benchmarks.results.stored_facts import facts_of
from geovp_benchmarks.statistics.intervals import Intervals
from geovp_benchmarks.statistics.samples import best_of_samples, mean_of_samples, reductions
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Curve:
    """Scores of a method, whose mean over clips is drawn."""

    label: str
    values: FloatArray  # [N, F], NaN where there is no value
    clips: Sequence[str]  # [N]
    bounds: Bounds  # of a score
    line_style: Mapping[str, Any]  # arguments of `Axes.plot`


def draw(page: Page, curves: Sequence[Curve], options: Options, step_s: float | None) -> Axes:
    """Draw curves with a legend over seconds, or over frames if their time is unknown.

    Few curves have intervals in the middle and at the end of the horizon, next to one another.
    """
    width_in = options.width_in or 4.8
    (axes,) = page.add_axes(width_in, 0.65 * width_in)
    means = [nanmean(curve.values, axis=0) for curve in curves]
    num_steps = len(means[0])
    spacing = 1 + num_steps // 4
    step_length = step_s or 1
    lines = {}
    for number, (curve, mean) in enumerate(zip(curves, means, strict=True)):
        # Equal lines that are drawn later are thinner, and their markers lie elsewhere.
        is_equal = [np.allclose(mean, other, rtol=2e-3, equal_nan=True) for other in means[number:]]
        (lines[curve.label],) = axes.plot(
            step_length * (1 + np.arange(num_steps)),
            mean,
            **curve.line_style,
            linewidth=1.3 * sum(is_equal),
            markevery=(number % spacing, spacing),
        )
        aside = 0.01 * num_steps * (number - len(curves) / 2)
        for step in {(num_steps + 1) // 2, num_steps}:
            if len(curves) <= options.max_intervals:
                values = curve.values[:, step - 1]
                score = Intervals().interval(values, curve.clips, curve.bounds)
                colour = curve.line_style["color"]
                at = step_length * (step + aside)
                axes.vlines(at, score.low, score.high, colour, linewidth=0.9)
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=step_s is None))
    page.add_legend(lines)
    return axes


def metrics(material: Material) -> list[str]:
    """Return the stored metrics in the order of the protocol, those over sets of pixels last."""
    order = list(material.protocol["metrics"])
    scores = [material.results.scores(method.name).values for method in material.methods]
    stored = {name for values in scores for name in values if FEATURES not in name}
    return sorted(stored, key=lambda name: ("@" in name, order.index(name.partition("@")[0]), name))


@context(SHEET)
def score_pages(groups: Sequence[Material], metric: str) -> list[Page]:
    """Draw a metric over the horizon, or its paired differences from a method.

    There is a figure per stratum, with equal axes. Figures over sets of pixels are svg only.
    """
    pages: list[Page] = []
    # A figure per stratum, or one for all clips.
    for number, material in enumerate(groups, 1):
        options, methods = material.options, material.shown
        curves = _curves(material, metric, methods)
        if not curves:
            continue
        # Name of the file, title and axis say what is compared.
        kind, title = "horizon", stored_facts.title(metric)
        facts = facts_of(metric, material.protocol)
        y_label = stored_facts.labelled(title, facts)
        if options.by:
            kind = f"strata-{options.by}-{number}"
            title += f": {material.results.label}"
        if options.against:
            kind, title = f"against-{kind}", f"{title}: difference from {options.against}"
            y_label = f"difference in {y_label}"
        # The subtitle says on how many clips and methods the figure rests.
        data, num_clips = stored_facts.data_name(material.protocol), len(curves[0].clips)
        subtitle = f"{data}: mean of {num_clips} clips"
        if len(curves) <= options.max_intervals and num_clips > 2:
            subtitle += " with 95 % intervals"
        if len(methods) < len(material.methods):
            subtitle += f"; {len(methods)} of {len(material.methods)} methods"
        # Figures of strata share their vertical axis.
        formats = ("svg",) if "@" in metric else ("png", "svg")
        page = Page(f"{kind}-{metric}", metric, title, subtitle, formats)
        axes = draw(page, curves, options, material.step_s)
        unit = "s" if material.step_s else "frames"
        # The vertical axis is short; units and arrows stay with their words.
        y_label = re.sub(r" (?=[(↑↓])", "\N{NO-BREAK SPACE}", y_label)
        y_label = textwrap.fill(y_label, int(7 * page.figure.get_figwidth()))
        axes.set(xlabel=f"horizon ({unit})", ylabel=y_label)
        if options.against:
            axes.axhline(0, color="0.5", linewidth=0.8, zorder=1)
        if pages:
            axes.sharey(pages[0].figure.axes[0])
            axes.autoscale_view()
        pages.append(page)
    return pages


def _curves(material: Material, metric: str, shown: Sequence[Method]) -> list[Curve]:
    """Return a curve per method that has values, of several samples two: their mean and best.

    Metrics of poses have a curve per pose source. Labels say where clips are missing.
    """
    facts = facts_of(metric, material.protocol)
    higher, is_of_poses = facts.get("higher_is_better"), facts["role"] == "trajectory"
    # Renderers of one pose source have the same poses.
    methods: dict[tuple[str, str], Method] = {}
    for method in shown:
        renderer = "" if is_of_poses else method.renderer or ""
        methods.setdefault((method.pose_source or method.label, renderer), method)
    # Differences are paired with the mean of the samples of the other method.
    bounds, against = stored_facts.bounds(facts), material.options.against
    reference: FloatArray | float = 0.0
    if against:
        (method,) = material.results.select(against).methods()
        reference = mean_of_samples(material.values(method, metric))[:, None]
        bounds = UNBOUNDED
    # A curve needs two steps with values; hollow markers show the best samples.
    curves = []
    styles = line_styles(list(methods))
    for line_style, ((source, _), method) in zip(styles, methods.items(), strict=True):
        samples = material.values(method, metric) - reference
        num_steps = np.isfinite(samples).any(axis=(0, 1)).sum()
        if method.label == against or num_steps < min(2, samples.shape[2]):
            continue
        if is_of_poses and not against and np.allclose(np.nan_to_num(samples), 0):
            continue  # true poses, whose errors are 0 but for rounding
        for suffix, reduce in reductions(samples.shape[1]).items():
            if reduce is best_of_samples and higher is None:
                continue
            values = reduce(samples, higher)
            label = (source if is_of_poses else method.label) + suffix
            num_clips = np.isfinite(values).any(axis=1).sum()
            if num_clips < len(values):
                label += f" (only {num_clips} of {len(values)} clips)"
            curves.append(Curve(label, values, material.protocol["clips"], bounds, line_style))
            colour = line_style["color"]
            line_style = {**line_style, "markerfacecolor": "white", "markeredgecolor": colour}
    return curves
