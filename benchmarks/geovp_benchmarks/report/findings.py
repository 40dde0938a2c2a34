"""The numbers of the findings that open a report, from the main table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from geovp_benchmarks.analysis.intervals import BlockBootstrap, Score
from geovp_benchmarks.plots.material import uses_ground_truth
from geovp_benchmarks.results.stored_facts import facts_of
from geovp_benchmarks.tables.table_model import Column, MethodScores, Table


@dataclass(frozen=True)
class Headline:
    """The first metric with a direction, of frames if possible, and the methods ranked by it."""

    column: Column
    unit: str
    methods: Sequence[MethodScores]  # scored on all clips, no sample selected by truth; best first
    clips: Sequence[str]

    @classmethod
    def of(cls, table: Table, protocol: Mapping[str, Any]) -> Self | None:
        """Rank the methods of the main table; return None without a metric with a direction."""
        clips = protocol["clips"]
        columns = [column for column in table.columns if column.higher_is_better is not None]
        if not columns:
            return None
        column = min(columns, key=lambda each: facts_of(each.key, protocol)["role"] != "frame")
        key = column.key
        methods = [
            method
            for method in table.methods
            if key in method.scores
            and method.num_clips == len(clips)
            and not method.is_oracle_selected
        ]
        methods.sort(
            key=lambda method: method.scores[key].mean, reverse=bool(column.higher_is_better)
        )
        return cls(column, facts_of(key, protocol)["unit"], methods, clips)

    def best(self, baseline: str, *, privileged: bool) -> MethodScores | None:
        """Return the best method other than the baseline with, or without, ground truth."""
        for method in self.methods:
            if method.label != baseline and uses_ground_truth(method.marks) == privileged:
                return method
        return None

    @property
    def judge(self) -> MethodScores | None:
        """Return the method whose score orders the clips."""
        return self.best("copy-last", privileged=False) or next(iter(self.methods), None)

    def score(self, clip: str) -> float:
        """Return the score of the judge on a clip, or NaN."""
        if self.judge is None:
            return float("nan")
        return float(self.judge.scores[self.column.key].values[self.clips.index(clip)])

    def gain(self, baseline: str) -> Score | None:
        """Return the gain of the best method, if possible without ground truth, or None."""
        best = self.best(baseline, privileged=False) or self.best(baseline, privileged=True)
        rival = next((other for other in self.methods if other.label == baseline), None)
        if best is None or rival is None:
            return None
        scores = (method.scores[self.column.key].values for method in (best, rival))
        return BlockBootstrap().interval(np.subtract(*scores), self.clips)
