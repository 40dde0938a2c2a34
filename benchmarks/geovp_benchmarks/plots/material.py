"""The data that all figures of a results folder share."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from geovp_benchmarks.plots.style import Options
from geovp_benchmarks.results.scores import nanmean
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.results.stored_facts import marks
from geovp_classic.types import FloatArray, Prediction


@dataclass(frozen=True)
class Material:
    """The results that all figures are drawn from, and what is shown of them."""

    results: Results
    options: Options

    @property
    def protocol(self) -> Mapping[str, Any]:
        """Return what all methods share."""
        return self.results.protocol()

    @cached_property
    def methods(self) -> list[Method]:
        """Return the methods that have scores."""
        return [method for method in self.results.methods() if method.num_clips]

    def values(self, method: Method, metric: str) -> FloatArray:
        """Return the scores [N, S, F] of a method by clip; NaN: not defined."""
        empty = np.full((len(self.protocol["clips"]), 1, self.protocol["num_future"]), np.nan)
        return self.results.scores(method.name).values.get(metric, empty)

    @property
    def shown(self) -> list[Method]:
        """Return the methods of a figure: copy-last, the best without ground truth, best others.

        They are ranked by the first metric of frames with a direction. Selected methods are all
        shown.
        """
        if self.results.selected:
            return self.methods
        metric, facts = next(iter(self.frame_metrics.items()), ("", {}))
        sign = -1 if facts.get("higher_is_better") else 1

        def error(method: Method) -> float:
            mean = nanmean(self.values(method, metric).ravel(), axis=0)
            return float(np.nan_to_num(sign * mean, nan=np.inf))

        ranked, first = sorted(self.methods, key=error), {"copy-last", self.options.against}
        fair = [m for m in ranked if m.label not in first and not uses_ground_truth(marks(m))]
        first.update(method.label for method in fair[:1])
        ranked.sort(key=lambda method: method.label not in first)
        return [m for m in self.methods if m in ranked[: self.options.max_methods]]

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
        """Return the mean seconds between two frames; None if those of clips differ by 2 %."""
        facts = self.results.clip_facts().values()
        intervals_s = [float(of_clip["interval_s"]) for of_clip in facts if "interval_s" in of_clip]
        for name in [] if intervals_s else self.clips[:1]:  # of earlier versions
            intervals_s = [float(np.diff(self.results.clips().read(name).times_s).mean())]
        if max(intervals_s, default=np.inf) > 1.02 * min(intervals_s, default=0.0):
            return None
        return float(np.mean(intervals_s))


def uses_ground_truth(marks: str) -> bool:
    """Return whether a method has more inputs than a camera height, full frames or right frames."""
    return bool(set(marks) - set("hwr"))
