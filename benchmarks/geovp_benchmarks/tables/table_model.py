"""What a table holds: columns, and rows with a value a clip; those chosen, those that are the best
or differ.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from geovp_benchmarks.analysis import intervals, statistics
from geovp_benchmarks.analysis.intervals import Interval
from geovp_benchmarks.analysis.statistics import Estimate
from geovp_benchmarks.results.score_names import UNBOUNDED, Bounds
from geovp_benchmarks.results.store import Method
from geovp_classic.errors import BadData
from geovp_classic.registry import nearest
from geovp_classic.types import BoolArray, FloatArray, IntArray

SIGNIFICANT = 0.05
MIN_EFFECTIVE = 8.0  # clips, below which no value is in bold
Spread = Literal["interval", "standard-error"]


@dataclass(frozen=True)
class Column:
    """One metric over one set of pixels."""

    key: str  # "psnr", "psnr@covered"
    heading: str
    higher_is_better: bool | None  # None: neither, so that no value is the best
    decimals: int
    unavailable: bool = False


@dataclass(frozen=True)
class MethodScores:
    """Scores of one method."""

    name: str
    marks: str
    num_clips: int
    complete: bool  # scored on all clips; only such rows compete for the best
    # its samples were chosen by comparing with the real future; such rows compete with each other
    by_truth: bool
    values: Mapping[
        str, FloatArray
    ]  # by column: a clip's mean over its steps [N], NaN where there is none
    estimates: Mapping[str, Estimate]  # by column
    intervals: Mapping[str, Interval]  # by column
    protocol: str = ""  # the id of what it was computed under

    def has_no_error(self, key: str) -> bool:
        """Return whether an error is zero on all clips up to rounding, as that of true poses."""
        values = self.values.get(key, np.array([np.nan]))
        return bool(np.isfinite(values).any() and np.nanmax(np.abs(values)) < 1e-6)

    @classmethod
    def of(
        cls,
        name: str,
        marks: str,
        values: Mapping[str, FloatArray],
        clips: Sequence[str],
        scored: BoolArray,  # [N], which clips the row has
        by_truth: bool = False,
        protocol: str = "",
        bounds: Mapping[str, Bounds] | None = None,  # by column, what values there can be
        level: float = 0.95,
    ) -> Self:
        """Return the scores with their estimates."""
        sequences, ends = intervals.sequences_of(clips), bounds or {}
        found = {
            key: intervals.interval(one, sequences, level, bounds=ends.get(key, UNBOUNDED))
            for key, one in values.items()
        }
        return cls(
            name,
            marks,
            int(scored.sum()),
            bool(scored.all()),
            by_truth,
            values,
            {key: statistics.over_clips(one) for key, one in values.items()},
            found,
            protocol,
        )


@dataclass(frozen=True)
class Table:
    """Columns and rows with the notes that explain them."""

    name: str  # of the files
    title: str
    columns: tuple[Column, ...]
    rows: tuple[MethodScores, ...]
    notes: tuple[str, ...]
    best: frozenset[tuple[str, str]]  # (row, column) in bold
    spread: Spread = "interval"
    starred: frozenset[tuple[str, str]] | None = None  # of a table of differences: significant ones
    caption: str = ""  # in LaTeX; "": the title
    label: str = ""  # in LaTeX; "": after the name

    def is_best(self, row: MethodScores, column: Column) -> bool:
        """Return whether the value is printed in bold."""
        return (row.name, column.key) in self.best

    def clips(self, row: MethodScores) -> str:
        """Return the number of clips and, if smaller, the effective sample size in column 1."""
        found = row.intervals.get(self.columns[0].key) if self.columns else None
        fewer = found is not None and found.effective < row.num_clips - 0.5
        worth = f" ({found.effective:.0f})" if found is not None and fewer else ""
        return f"{row.num_clips}{worth}"

    def texts(self, row: MethodScores, column: Column) -> tuple[str, str]:
        """Return the mean, and the interval or standard error with a differing number of clips."""
        estimate = row.estimates.get(column.key)
        if estimate is None or int(estimate.count) == 0:
            return "unavailable" if column.unavailable else "-", ""
        digits, found = column.decimals, row.intervals[column.key]
        error = f" ± {float(estimate.error):.{digits}f}" if np.isfinite(estimate.error) else ""
        if self.spread == "interval":
            error = (
                f" [{found.low:.{digits}f}, {found.high:.{digits}f}]"
                if np.isfinite(found.low)
                else ""
            )
        star = "*" if self.starred is not None and (row.name, column.key) in self.starred else ""
        count = f" (n={int(estimate.count)})" if int(estimate.count) != row.num_clips else ""
        sign = "" if self.starred is None else "+"
        return f"{float(estimate.mean):{sign}.{digits}f}{star}", error + count


@dataclass(frozen=True)
class Choice:
    """Rows and columns in the order asked for; all, as the matrix has them, where none
    are named.
    """

    methods: tuple[
        str, ...
    ] = ()  # rows as tables name them; a method's name stands for all of its rows
    metrics: tuple[str, ...] = ()  # columns: "psnr", "psnr@covered", "coverage"

    def select(self, methods: Sequence[Method]) -> list[Method]:
        """Return the methods of the chosen rows; BadData when a name is none of theirs."""
        found = {}
        for name in self.methods:
            own = [method for method in methods if _is_of(name, method.label)]
            if not own:
                raise BadData(
                    f"no method is called {name!r}"
                    f"{nearest(name, (method.label for method in methods))}"
                )
            found.update({method.name: method for method in own})
        return [*found.values()] if self.methods else list(methods)

    def rows(self, rows: Sequence[MethodScores]) -> list[MethodScores]:
        """Return the chosen ones of the chosen methods' rows, each once; BadData when a name is
        none of theirs.
        """
        if not self.methods:
            return list(rows)
        found = {}
        for name in self.methods:
            found.update(
                {row.name: row for row in rows if row.name == name or _is_of(row.name, name)}
            )
        if not found:
            known = ", ".join(row.name for row in rows) or "none: see below the table why"
            raise BadData(
                f"--methods {', '.join(self.methods)}: no such method; known with scores are "
                f"{known}"
            )
        return [*found.values()]

    def columns(self, metrics: Iterable[str], keys: Iterable[str]) -> list[str]:
        """Return the chosen columns, none where all are meant; BadData for an unknown name."""
        known = [*dict.fromkeys([*metrics, *keys])]
        for name in self.metrics:
            if name not in known:
                raise BadData(f"--metrics: no column is called {name!r}{nearest(name, known)}")
        return [*dict.fromkeys(self.metrics)]

    def including(self, row: str) -> Self:
        """Return the choice with a row that others are compared with."""
        return replace(self, methods=(row, *self.methods)) if self.methods else self


EVERYTHING = Choice()


def _is_of(name: str, label: str) -> bool:
    """Return whether a row's name is a method's label, or that with how its samples were
    reduced behind.
    """
    return name == label or name.startswith(f"{label}, ")


def different(rows: Sequence[MethodScores], column: Column) -> list[MethodScores]:
    """Return the rows of differences with an interval in a column that excludes zero."""
    return [
        row
        for row in rows
        if column.key in row.intervals and row.intervals[column.key].excludes_zero
    ]


def best(
    rows: Sequence[MethodScores], columns: Sequence[Column], clips: Sequence[str]
) -> frozenset[tuple[str, str]]:
    """Return (row, column) where no method with the same or fewer inputs is significantly better.

    A row without a rival is not marked, nor one that, like a rival with a better mean, has less
    than `MIN_EFFECTIVE` effective clips.
    """
    sequences = intervals.sequences_of(clips)
    marked: set[tuple[str, str]] = set()
    for column in columns:
        if column.higher_is_better is None:
            continue
        scored = [row for row in rows if row.complete and _has_mean(row, column.key)]
        for row in scored:
            rivals = [other for other in scored if other is not row and _may_rival(other, row)]
            if rivals and not _is_beaten(row, rivals, column, sequences):
                marked.add((row.name, column.key))
    return frozenset(marked)


def _has_mean(row: MethodScores, key: str) -> bool:
    return key in row.values and bool(np.isfinite(row.estimates[key].mean))


def _may_rival(other: MethodScores, row: MethodScores) -> bool:
    """Return whether a method has no privileged input that the row lacks."""
    return set(other.marks) <= set(row.marks) and other.by_truth == row.by_truth


def _is_beaten(
    row: MethodScores, rivals: Sequence[MethodScores], column: Column, sequences: IntArray
) -> bool:
    """Return whether a rival is better, p < .05 after Bonferroni's correction for better means.

    Too few effective clips count as beaten.
    """
    sign = 1.0 if column.higher_is_better else -1.0
    key = column.key
    mean = sign * float(row.estimates[key].mean)
    better = [rival for rival in rivals if sign * float(rival.estimates[key].mean) > mean]
    if not column.higher_is_better and any(rival.has_no_error(key) for rival in better):
        return True  # a positive error is worse than none, which needs no test
    if any(method.intervals[key].effective < MIN_EFFECTIVE for method in (row, *better)):
        return True
    for rival in sorted(better, key=lambda rival: -sign * float(rival.estimates[key].mean)):
        gap = sign * (rival.values[key] - row.values[key])
        if intervals.interval(gap, sequences).p_zero * len(better) < SIGNIFICANT:
            return True
    return False
