"""The findings that open a report, written from the numbers of the main table."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from geovp_benchmarks.analysis import intervals
from geovp_benchmarks.results.stored_facts import MARKS, title
from geovp_benchmarks.tables.table_model import MIN_EFFECTIVE, Column, MethodScores, Table


@dataclass(frozen=True)
class Headline:
    """The first metric with a direction, of frames if possible, and the methods ranked by it."""

    column: Column | None
    methods: tuple[
        MethodScores, ...
    ]  # scored on all clips, samples not selected by the future; best first
    clips: tuple[str, ...]
    name: str = ""  # of the metric
    unit: str = ""

    @classmethod
    def of(cls, table: Table, protocol: Mapping[str, Any]) -> Self:
        """Rank the methods of the main table."""
        clips = tuple(protocol["clips"])
        columns = [column for column in table.columns if column.higher_is_better is not None]
        if not columns:
            return cls(None, (), clips)
        facts = protocol["metrics"]
        column = max(
            columns, key=lambda column: facts[column.key.partition("@")[0]]["role"] == "frame"
        )
        methods = [
            row
            for row in table.rows
            if row.complete and not row.by_truth and column.key in row.intervals
        ]
        sign = -1.0 if column.higher_is_better else 1.0
        methods.sort(key=lambda row: sign * row.intervals[column.key].mean)
        unit = str(facts[column.key.partition("@")[0]].get("unit", ""))
        return cls(column, tuple(methods), clips, title(column.key), unit)

    def best(self, baseline: str, *, uses_truth: bool) -> MethodScores | None:
        """Return the best method other than the baseline with, or without, ground truth."""
        methods = [row for row in self.methods if row.name != baseline]
        return next((row for row in methods if _uses_truth(row) == uses_truth), None)

    def sentences(self, baseline: str) -> list[str]:
        """State the best methods without and with ground truth, and a gain."""
        if self.column is None:
            return []
        best = self.best(baseline, uses_truth=False)
        return [
            self._best_sentence(best, "Without ground truth", baseline),
            self._best_sentence(
                self.best(baseline, uses_truth=True),
                "With ground truth (truth)",
                baseline,
            ),
            self._gain_sentence(best or self.best(baseline, uses_truth=True), baseline),
        ]

    @property
    def judge(self) -> MethodScores | None:
        """Return the method whose score orders the clips."""
        return self.best("copy-last", uses_truth=False) or next(iter(self.methods), None)

    def score(self, clip: str) -> float:
        """Return the score of the judge on a clip, or NaN."""
        if self.judge is None or self.column is None or clip not in self.clips:
            return float("nan")
        return float(self.judge.values[self.column.key][self.clips.index(clip)])

    def _best_sentence(self, row: MethodScores | None, condition: str, baseline: str) -> str:
        if row is None or self.column is None:
            return f"{condition}, no method has scores on all clips, {baseline} aside."
        inputs = ", ".join(meaning for mark, meaning in MARKS.values() if mark in row.marks)
        condition = condition.replace("(truth)", f"({inputs})")
        interval = row.intervals[self.column.key]
        return f"{condition}, {row.name} is best: {self.name} {self._text(interval)}."

    def _gain_sentence(self, row: MethodScores | None, baseline: str) -> str:
        rival = next((method for method in self.methods if method.name == baseline), None)
        if row is None or rival is None or self.column is None:
            return f"The gain over {baseline} is unknown: a method or {baseline} lacks scores."
        key = self.column.key
        difference = row.values[key] - rival.values[key]
        gain = intervals.interval(difference, intervals.sequences_of(self.clips))
        is_significant = gain.low > 0 or gain.high < 0
        verdict = "significant" if is_significant else "not significant"
        if gain.effective < MIN_EFFECTIVE:
            verdict += f" (and {gain.effective:.0f} effective clips are too few to rely on)"
        return (
            f"Compared with {baseline}, {row.name} changes {self.name} by "
            f"{self._text(gain, '+')}, a difference that is {verdict}."
        )

    def _text(self, interval: intervals.Interval, sign: str = "") -> str:
        digits = 2 if self.column is None else self.column.decimals
        mean = f"{interval.mean:{sign}.{digits}f} {self.unit}".strip()
        if not np.isfinite(interval.low):
            return f"{mean} (fewer than three clips: no interval)"
        return f"{mean} [{interval.low:{sign}.{digits}f}, {interval.high:{sign}.{digits}f}]"


def _uses_truth(row: MethodScores) -> bool:
    """Return whether a method has inputs that a calibrated camera does not give."""
    calibration = {MARKS[name][0] for name in ("CAMERA_HEIGHT", "FULL_FRAMES", "RIGHT_FRAMES")}
    return not set(row.marks) <= calibration
