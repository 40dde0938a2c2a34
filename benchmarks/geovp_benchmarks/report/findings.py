"""The findings that open a report, written from the numbers of the main table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from geovp_benchmarks.results.score_names import UNBOUNDED
from geovp_benchmarks.results.stored_facts import MARKS, title
from geovp_benchmarks.tables.table_model import Column, MethodScores, Score, Table


@dataclass(frozen=True)
class Headline:
    """The first metric with a direction, of frames if possible, and the methods ranked by it."""

    column: Column | None
    methods: Sequence[MethodScores]  # scored on all clips, no sample selected by truth; best first
    clips: Sequence[str]
    metric: str = ""
    unit: str = ""

    @classmethod
    def of(cls, table: Table, protocol: Mapping[str, Any]) -> Self:
        """Rank the methods of the main table."""
        facts, clips = protocol["metrics"], protocol["clips"]
        columns = [column for column in table.columns if column.higher_is_better is not None]
        columns.sort(key=lambda column: facts[column.key.partition("@")[0]]["role"] != "frame")
        if not columns:
            return cls(None, (), clips)
        column = columns[0]
        methods = [
            method
            for method in table.methods
            if method.num_clips == len(clips)
            and not method.is_oracle_selected
            and column.key in method.scores
        ]
        sign = -1.0 if column.higher_is_better else 1.0
        methods.sort(key=lambda method: sign * method.scores[column.key].mean)
        unit = facts[column.key.partition("@")[0]].get("unit", "")
        return cls(column, methods, clips, title(column.key), unit)

    def best(self, baseline: str, *, uses_truth: bool) -> MethodScores | None:
        """Return the best method other than the baseline with, or without, ground truth."""
        methods = [method for method in self.methods if method.label != baseline]
        return next((method for method in methods if _uses_truth(method) == uses_truth), None)

    @property
    def judge(self) -> MethodScores | None:
        """Return the method whose score orders the clips."""
        return self.best("copy-last", uses_truth=False) or next(iter(self.methods), None)

    def score(self, clip: str) -> float:
        """Return the score of the judge on a clip, or NaN."""
        if self.judge is None or self.column is None or clip not in self.clips:
            return float("nan")
        return float(self.judge.scores[self.column.key].values[self.clips.index(clip)])

    def sentences(self, baseline: str) -> list[str]:
        """State the best methods without and with ground truth, and a gain."""
        if self.column is None:
            return []
        without = self.best(baseline, uses_truth=False)
        privileged = self.best(baseline, uses_truth=True)
        marks = privileged.marks if privileged else ""
        inputs = ", ".join(meaning for mark, meaning in MARKS.values() if mark in marks)
        return [
            self._best_sentence("Without ground truth", without),
            self._best_sentence(f"With ground truth ({inputs or 'any'})", privileged),
            self._gain_sentence(without or privileged, baseline),
        ]

    def _best_sentence(self, condition: str, method: MethodScores | None) -> str:
        if method is None or self.column is None:
            return f"{condition}, no method has scores on all clips."
        score = self._text(method.scores[self.column.key])
        return f"{condition}, {method.label} is best: {self.metric} {score}."

    def _gain_sentence(self, method: MethodScores | None, baseline: str) -> str:
        rival = next((other for other in self.methods if other.label == baseline), None)
        if method is None or rival is None or self.column is None:
            return f"The gain over {baseline} is unknown: a method or {baseline} lacks scores."
        key = self.column.key
        difference = method.scores[key].values - rival.scores[key].values
        gain = Score.of(difference, self.clips, UNBOUNDED)
        is_significant = gain.low > 0 or gain.high < 0
        verdict = f"a difference that is {'' if is_significant else 'not '}significant"
        if gain.has_few_clips:
            clips = f"{gain.effective_clips:.0f} effective clips"
            verdict = f"which is not tested: {clips} are too few"
        return (
            f"Compared with {baseline}, {method.label} changes {self.metric} by "
            f"{self._text(gain, '+')}, {verdict}."
        )

    def _text(self, score: Score, sign: str = "") -> str:
        digits = 2 if self.column is None else self.column.decimals
        mean = f"{score.mean:{sign}.{digits}f} {self.unit}".strip()
        if not np.isfinite(score.low):
            return f"{mean} (fewer than three clips: no interval)"
        return f"{mean} [{score.low:{sign}.{digits}f}, {score.high:{sign}.{digits}f}]"


def _uses_truth(method: MethodScores) -> bool:
    """Return whether a method has inputs that a calibrated camera does not give."""
    calibration = {MARKS[name][0] for name in ("CAMERA_HEIGHT", "FULL_FRAMES", "RIGHT_FRAMES")}
    return not set(method.marks) <= calibration
