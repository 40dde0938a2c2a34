"""The data that all figures of a results folder share, and a drawn figure."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from matplotlib.figure import Figure

from geovp_benchmarks.plots import style
from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.store import Method, Results, Scores
from geovp_benchmarks.tables.table_model import EVERYTHING, Choice
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Page:
    """One figure, ready to be written."""

    name: str  # of the file, without its ending
    kind: str  # "horizon", "samples", "strip", "inpainted" or "paths"
    subject: str  # the metric or the clip
    caption: str
    figure: Figure
    formats: tuple[str, ...]


@dataclass(frozen=True)
class Material:
    """The results that all figures are drawn from."""

    results: Results
    protocol: Mapping[str, Any]
    methods: Sequence[Method]  # with rows
    scores: Mapping[str, Scores]  # by method
    step_s: float | None  # seconds from one horizon step to the next, None where clips differ

    @classmethod
    def read(cls, results: Results, choice: Choice = EVERYTHING) -> Self:
        """Read everything but images; raise BadData without results or without a named method."""
        protocol = results.protocol()
        methods = choice.select(results.methods())
        ran = [method for method in methods if method.status in ("done", "partial")]
        scores = {method.name: results.scores(method.name) for method in ran}
        methods = [method for method in ran if scores[method.name].values]
        return cls(results, protocol, methods, scores, _step_s(results, protocol["num_past"]))

    def values(self, method: Method, metric: str) -> FloatArray:
        """Return the scores [N, S, F] of a method by clip; NaN: not defined."""
        empty = np.full((len(self.protocol["clips"]), 1, self.protocol["num_future"]), np.nan)
        return self.scores[method.name].values.get(metric, empty)

    @property
    def data(self) -> str:
        """Return the data set and its split."""
        return stored_facts.data_name(self.protocol)


def title(metric: str) -> str:
    """Return the name of a metric as a heading."""
    name = stored_facts.title(metric)
    return name[:1].upper() + name[1:]


def page(
    kind: str,
    name: str,
    subject: str,
    heading: style.Heading,
    figure: Figure,
    formats: tuple[str, ...] = ("png", "svg"),
) -> Page:
    """Return the page of a figure; `name` may hold any characters."""
    stem = re.sub("[^A-Za-z0-9]+", "-", name).strip("-").lower()
    caption = f"{heading.title}. {heading.subtitle}."
    return Page(f"{kind}-{stem}", kind, subject, caption, figure, formats)


def _step_s(results: Results, num_past: int) -> float | None:
    """Return the seconds between two horizon steps of kept clips; None if they vary by 10 %."""
    clips = [results.clip(name) for name, _ in results.clips()]
    steps_s = [np.diff(clip.times_s[num_past - 1 :]).mean() for clip in clips]
    if not steps_s or max(steps_s) > 1.1 * min(steps_s):
        return None
    return float(np.mean(steps_s))
