"""The model of a table: methods, columns, and the mean of each method in each column."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Self

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.analysis.intervals import BlockBootstrap, sequences_of
from geovp_benchmarks.results.score_names import UNBOUNDED, Bounds
from geovp_classic.errors import BadData, nearest
from geovp_classic.types import FloatArray

Spread = Literal["interval", "standard-error"]


@dataclass(frozen=True)
class Column:
    """One metric over one set of pixels or horizon."""

    key: str  # "psnr", "psnr@covered", "psnr t+5"
    heading: str
    higher_is_better: bool | None  # None: neither, so that no value is in bold
    decimals: int
    is_unavailable: bool = False


@dataclass(frozen=True)
class Score:
    """The mean of a method in one column over clips, and its 95 % interval."""

    mean: float
    low: float = float("nan")
    high: float = float("nan")
    standard_error: float = float("nan")  # as if clips were independent
    clips: int = 0  # that have a value
    effective_clips: float = 0.0
    # [N] by clip, each a mean over steps; empty for a published score
    values: FloatArray = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of(
        cls,
        values: FloatArray,  # [N]; NaN is left out
        clips: Sequence[str],
        bounds: Bounds = UNBOUNDED,
        level: float = 0.95,
    ) -> Self:
        """Return the mean of values by clip."""
        sequences = sequences_of(tuple(clips))
        interval = BlockBootstrap(level).interval(values, sequences, bounds)
        error, count = statistics.standard_error(values), int(np.isfinite(values).sum())
        ends = interval.low, interval.high
        return cls(interval.mean, *ends, error, count, interval.effective, values)

    @property
    def is_exact(self) -> bool:
        """Return whether an error is zero on all clips up to rounding, as that of true poses."""
        return self.clips > 0 and bool(np.nanmax(np.abs(self.values)) < 1e-6)

    @property
    def has_few_clips(self) -> bool:
        """Return whether the effective clips are too few to rely on the interval."""
        return self.effective_clips < 8


@dataclass(frozen=True)
class MethodScores:
    """The scores of a method, or of its best samples."""

    label: str
    scores: Mapping[str, Score]  # by column, where there is a value
    marks: str = ""  # of privileged inputs
    num_clips: int = 0  # only methods with scores on all clips compete
    is_oracle_selected: bool = False  # by the real future; such methods compete with each other
    protocol: str = ""  # the id of the protocol that it was computed under


@dataclass(frozen=True)
class Table:
    """Methods and columns with the notes that explain them."""

    name: str  # of the files
    title: str
    columns: Sequence[Column]
    methods: Sequence[MethodScores]
    notes: Sequence[str] = ()
    best: Collection[tuple[str, str]] = ()  # (method, column) in bold
    spread: Spread = "interval"
    starred: Collection[tuple[str, str]] | None = None  # significant ones of a table of differences

    def clips(self, method: MethodScores) -> str:
        """Return the number of clips, and the effective one in the first column if smaller."""
        score = method.scores.get(self.columns[0].key) if self.columns else None
        if score is None or score.effective_clips >= method.num_clips - 0.5:
            return str(method.num_clips or "-")
        return f"{method.num_clips} ({score.effective_clips:.0f})"

    def texts(self, method: MethodScores, column: Column, bold: str = "{}") -> tuple[str, str]:
        """Return the mean, and the interval or standard error with a differing number of clips."""
        score, digits = method.scores.get(column.key), column.decimals
        if score is None or np.isnan(score.mean):
            return "unavailable" if column.is_unavailable else "-", ""
        place = (method.label, column.key)
        mean = f"{score.mean:{'' if self.starred is None else '+'}.{digits}f}"
        if self.starred is not None and place in self.starred:
            mean += "*"
        if place in self.best:
            mean = bold.format(mean)
        error = ""
        if self.spread == "interval" and np.isfinite(score.low):
            error = f" [{score.low:.{digits}f}, {score.high:.{digits}f}]"
        if self.spread == "standard-error" and np.isfinite(score.standard_error):
            error = f" ± {score.standard_error:.{digits}f}"
        return mean, error if score.clips == method.num_clips else f"{error} (n={score.clips})"


def selected_columns(names: Sequence[str], columns: Iterable[str]) -> list[str]:
    """Return the names of columns; raise BadData for an unknown one."""
    columns = list(columns)
    for name in names:
        if name not in columns:
            raise BadData(f"--metrics: no column is called {name!r}{nearest(name, columns)}")
    return list(names)


def best(
    methods: Sequence[MethodScores], columns: Sequence[Column], clips: Sequence[str]
) -> set[tuple[str, str]]:
    """Return (method, column) where no method with the same or fewer inputs is better.

    A method without such a rival is not in bold, nor is one where there are too few clips to tell.
    """
    bold = set()
    for column in columns:
        key, sign = column.key, 1.0 if column.higher_is_better else -1.0
        scored = [m for m in methods if len(clips) == m.num_clips and key in m.scores]
        for method in scored if column.higher_is_better is not None else ():
            rivals = [
                rival.scores[key]
                for rival in scored
                if rival is not method
                and set(rival.marks) <= set(method.marks)
                and rival.is_oracle_selected == method.is_oracle_selected
            ]
            if rivals and not _is_beaten(method.scores[key], rivals, sign, clips):
                bold.add((method.label, key))
    return bold


def _is_beaten(score: Score, rivals: Sequence[Score], sign: float, clips: Sequence[str]) -> bool:
    """Return whether a rival is better, p < .05 after Bonferroni's correction for better means.

    Too few effective clips count as beaten. `sign` is -1 where a lower value is better.
    """
    better = [rival for rival in rivals if sign * rival.mean > sign * score.mean]
    better.sort(key=lambda rival: -sign * rival.mean)
    if any(tested.has_few_clips for tested in (score, *better)):
        return True
    if sign < 0 and any(rival.is_exact for rival in better):
        return True  # a positive error is worse than none, which needs no test
    gaps = (
        Score.of(sign * (rival.values - score.values), clips, level=1 - 0.05 / len(better))
        for rival in better
    )
    return any(gap.low > 0 for gap in gaps)
