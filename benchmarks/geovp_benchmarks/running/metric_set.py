"""The metrics of a matrix: built, tried once, and described for protocol.json."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from geovp_benchmarks.matrix.components import Failure, build
from geovp_benchmarks.matrix.values import Spec
from geovp_benchmarks.results.score_names import CONFIDENCE, COVERAGE
from geovp_benchmarks.results.stored_facts import stored_bounds
from geovp_benchmarks.running.scoring import Metrics
from geovp_classic import registry
from geovp_classic.errors import BadData


@dataclass(frozen=True)
class MetricSet:
    """Metrics by column, a Failure in place of one that cannot be built here."""

    frame: Mapping[str, Spec]
    trajectory: Mapping[str, Spec]
    built: Mapping[str, Any]

    @classmethod
    def build(cls, frame: Mapping[str, Spec], trajectory: Mapping[str, Spec]) -> Self:
        """The metrics of a matrix file; a wrong name or setting is raised."""
        roles = {"frame_metrics": frame, "trajectory_metrics": trajectory}
        built = {
            name: build(role, name, spec)
            for role, specs in roles.items()
            for name, spec in specs.items()
        }
        return cls(frame, trajectory, built)

    def unavailable(self, size_px: tuple[int, int]) -> dict[str, str]:
        """Why metrics cannot be computed here; each frame metric is tried, since its weights may be
        missing.
        """
        reasons = {
            name: metric.reason
            for name, metric in self.built.items()
            if isinstance(metric, Failure)
        }
        blank = np.zeros((1, size_px[1], size_px[0], 3), np.uint8)
        for name in (name for name in self.frame if name not in reasons):
            try:
                self.built[name](blank, blank, None)
            except BadData:
                raise
            except Exception as error:  # one metric less, and the run goes on
                reasons[name] = Failure.of(error).reason
        return reasons

    def chosen(self, columns: Iterable[str]) -> Metrics:
        """The metrics of these columns."""
        names = set(columns)
        frame = {name: self.built[name] for name in self.frame if name in names}
        return Metrics(frame, {name: self.built[name] for name in self.trajectory if name in names})

    def describe(self, columns: Iterable[str]) -> dict[str, Any]:
        """The resolved settings of these columns."""
        return {column: registry.describe(self.built[column]) for column in columns}

    def about(self, unavailable: Mapping[str, str]) -> dict[str, Any]:
        """The meaning of the columns, for protocol.json."""
        entries: dict[str, Any] = {}
        for role, specs in (("frame", self.frame), ("trajectory", self.trajectory)):
            for name, spec in specs.items():
                entries[name] = {"role": role, "asked": spec, "unavailable": unavailable.get(name)}
                entries[name] |= _meaning(self.built[name])
        shares = {
            "role": "frame",
            "unit": "",
            "higher_is_better": None,
            "unavailable": None,
            "bounds": [0.0, 1.0],
        }
        entries[COVERAGE] = {**shares, "definition": "fraction of pixels that were not inpainted"}
        definition = (
            "coverage times tracked past frames over all frames up to the step; no probability"
        )
        return {**entries, CONFIDENCE: {**shares, "definition": definition}}


def _meaning(metric: Any) -> dict[str, Any]:
    if isinstance(metric, Failure):
        return {}
    definition = getattr(metric, "protocol", "")  # which of the usual definitions it follows
    direction, ends = metric.higher_is_better, stored_bounds(metric)
    meaning = {
        "unit": metric.unit,
        "higher_is_better": direction,
        "definition": definition,
        "bounds": ends,
    }
    device = getattr(metric, "device", "")  # of a network; None is the CPU
    return meaning if device == "" else {**meaning, "device": device or "cpu"}
