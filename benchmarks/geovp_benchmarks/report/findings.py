"""The findings that open a report, written from the numbers of the main table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from geovp_benchmarks.analysis.intervals import BlockBootstrap, Score
from geovp_benchmarks.plots.material import uses_ground_truth
from geovp_benchmarks.results.stored_facts import MARKS, facts_of, title
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

    def sentences(self, baseline: str) -> list[str]:
        """State the best methods without and with ground truth, and a gain."""
        fair, best = (self.best(baseline, privileged=is_so) for is_so in (False, True))
        marks = best.marks if best else ""
        inputs = ", ".join(meaning for mark, meaning in MARKS.values() if mark in marks)
        return [
            self._best_sentence("Without ground truth", fair),
            self._best_sentence(f"With ground truth ({inputs or 'any'})", best),
            self._gain_sentence(fair or best, baseline),
        ]

    def _best_sentence(self, condition: str, method: MethodScores | None) -> str:
        if method is None:
            return f"{condition}, no method has scores on all clips."
        key = self.column.key
        return (
            f"{condition}, {method.label} is best: {title(key)} {self._text(method.scores[key])}."
        )

    def _gain_sentence(self, method: MethodScores | None, baseline: str) -> str:
        rival = next((other for other in self.methods if other.label == baseline), None)
        if method is None or rival is None:
            return f"The gain over {baseline} is unknown: a method or {baseline} lacks scores."
        key = self.column.key
        difference = method.scores[key].values - rival.scores[key].values
        gain = BlockBootstrap().interval(difference, self.clips)
        verdict = f"which is {'not ' * (gain.low <= 0 <= gain.high)}significant"
        if gain.has_few_clips:
            clips = f"{gain.effective_clips:.0f} effective clips"
            verdict = f"which is not tested: {clips} are too few"
        change = self._text(gain, "+")
        return (
            f"Compared with {baseline}, {method.label} changes {title(key)} by {change}, {verdict}."
        )

    def _text(self, score: Score, sign: str = "") -> str:
        style = f"{sign}.{self.column.decimals}f"
        mean = f"{score.mean:{style}} {self.unit}".strip()
        if not np.isfinite(score.low):
            return f"{mean} (fewer than three clips: no interval)"
        return f"{mean} [{score.low:{style}},\N{NO-BREAK SPACE}{score.high:{style}}]"
