"""The data that all figures of a results folder share."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from geovp_benchmarks.plots.style import Options
from geovp_benchmarks.results.scores import nanmean
from geovp_benchmarks.results.store import Method, Results, Scores
from geovp_benchmarks.results.stored_facts import marks
from geovp_classic.types import FloatArray, Prediction


@dataclass(frozen=True)
class Material:
    """The results that all figures are drawn from."""

    results: Results
    protocol: Mapping[str, Any]
    methods: Sequence[Method]  # that have scores
    scores: Mapping[str, Scores]  # by the name of a method
    reference: Method | None  # that the others are compared with

    @classmethod
    def read(cls, results: Results, options: Options) -> Self:
        """Read everything but images; raise BadData without results or without a named method."""
        labels = [method.label for method in results.methods() if method.num_clips]
        if options.against is not None:
            labels.append(options.against)
        methods = results.select(*dict.fromkeys(labels)).methods()
        scores = {method.name: results.scores(method.name) for method in methods}
        reference = next((method for method in methods if method.label == options.against), None)
        return cls(results, results.protocol(), methods, scores, reference)

    def values(self, method: Method, metric: str) -> FloatArray:
        """Return the scores [N, S, F] of a method by clip; NaN: not defined."""
        empty = np.full((len(self.protocol["clips"]), 1, self.protocol["num_future"]), np.nan)
        return self.scores[method.name].values.get(metric, empty)

    def shown(self, max_methods: int) -> list[Method]:
        """Return the methods of a figure: copy-last, the best without ground truth, best others.

        They are ranked by the first metric of frames with a direction.
        """
        metric, facts = next(iter(self.frame_metrics.items()), ("", {}))
        sign = -1 if facts.get("higher_is_better") else 1

        def error(method: Method) -> float:
            mean = nanmean(self.values(method, metric).ravel(), axis=0)
            return float(np.nan_to_num(sign * mean, nan=np.inf))

        ranked = sorted(self.methods, key=error)
        first = [m for m in ranked if m == self.reference or m.label == "copy-last"]
        fair = [m for m in ranked if not uses_ground_truth(marks(m)) and m not in first]
        names = dict.fromkeys(method.name for method in [*first, *fair[:1], *ranked])
        shown = list(names)[:max_methods]
        return [method for method in self.methods if method.name in shown]

    @property
    def frame_metrics(self) -> dict[str, Mapping[str, Any]]:
        """Return the frame metrics that have a direction, with what the protocol says of them."""
        return {
            metric: facts
            for metric, facts in self.protocol["metrics"].items()
            if facts["role"] == "frame" and facts.get("higher_is_better") is not None
        }

    def predictions(
        self, clip: str, methods: Sequence[Method]
    ) -> Iterator[tuple[Method, Prediction]]:
        """Yield the kept predictions of a clip with their methods."""
        for method in methods:
            predictions = self.results.predictions(method)
            if clip in predictions.names:
                yield method, predictions.read(clip)

    @property
    def clips(self) -> list[str]:
        """Return the kept clips of the protocol."""
        return [name for name in self.results.clips().names if name in self.protocol["clips"]]

    @cached_property
    def step_s(self) -> float | None:
        """Return the seconds between two frames, known from the first kept clip."""
        for name in self.clips:
            return float(np.diff(self.results.clips().read(name).times_s).mean())
        return None


def uses_ground_truth(marks: str) -> bool:
    """Return whether a method has more inputs than a camera height, full frames or right frames."""
    return bool(set(marks) - set("hwr"))
