"""The data that all figures of a results folder share."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.plots.style import Options
from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.store import Method, Results, Scores
from geovp_benchmarks.tables.table_model import Choice
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Material:
    """The results that all figures are drawn from."""

    results: Results
    protocol: Mapping[str, Any]
    scores: Mapping[str, Scores]  # of all methods that have some
    methods: Sequence[Method]  # that figures show
    reference: Method | None  # that the others are compared with

    @classmethod
    def read(cls, results: Results, options: Options) -> Self:
        """Read everything but images; raise BadData without results or without a named method."""
        protocol, choice = results.protocol(), options.choice
        if options.against and choice.methods:
            choice = Choice([*choice.methods, options.against])
        methods = choice.select(results.methods())
        stored = {method.name: results.scores(method.name) for method in methods}
        scores = {name: each for name, each in stored.items() if each.values}
        methods = [method for method in methods if method.name in scores]
        references = Choice((options.against,)).select(methods) if options.against else []
        ranked = [*references, *_ranked(methods, scores, protocol["metrics"])]
        names = list(dict.fromkeys(method.name for method in ranked))[: options.max_methods]
        shown = [method for method in methods if method.name in names]
        return cls(results, protocol, scores, shown, next(iter(references), None))

    def values(self, method: Method, metric: str) -> FloatArray:
        """Return the scores [N, S, F] of a method by clip; NaN: not defined."""
        empty = np.full((len(self.protocol["clips"]), 1, self.protocol["num_future"]), np.nan)
        return self.scores[method.name].values.get(metric, empty)

    @cached_property
    def step_s(self) -> float | None:
        """Return the seconds between two frames, known from the first kept clip."""
        for name, _ in self.results.clips():
            return float(np.diff(self.results.clip(name).times_s).mean())
        return None


def uses_ground_truth(marks: str) -> bool:
    """Return whether a method has more inputs than a camera height, full frames or right frames."""
    return bool(set(marks) - set("hwr"))


def _ranked(
    methods: Sequence[Method], scores: Mapping[str, Scores], facts: Mapping[str, Any]
) -> list[Method]:
    """Return copy-last, the best method without ground truth, and all methods, the best first.

    They are ranked by the first metric of frames with a direction.
    """
    metrics = [
        name
        for name, about in facts.items()
        if about["role"] == "frame" and about.get("higher_is_better") is not None
    ]

    def error(method: Method) -> float:
        values = scores[method.name].values.get(metrics[0], np.full(1, np.nan))
        mean = float(statistics.over_clips(values.ravel()).mean)
        sign = -1 if facts[metrics[0]]["higher_is_better"] else 1
        return float(np.nan_to_num(sign * mean, nan=np.inf))

    ranked = sorted(methods, key=error) if metrics else methods
    copies = [method for method in ranked if method.label == "copy-last"]
    fair = [method for method in ranked if not uses_ground_truth(stored_facts.marks(method))]
    return [*copies, *[method for method in fair if method not in copies][:1], *ranked]
