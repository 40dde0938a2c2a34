"""The model of a table: rows, columns, and the mean of each row in each column."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geovp_benchmarks.statistics.intervals import Intervals, holm
from geovp_benchmarks.statistics.score import Score
from geovp_classic.errors import BadData, nearest


@dataclass(frozen=True)
class Column:
    """One metric over one set of pixels or horizon."""

    key: str  # "psnr", "psnr@covered", "psnr t+5"
    heading: str
    higher_is_better: bool | None  # None: neither, so that no value is in bold
    digits: str  # format of numbers, such as ".2f"
    missing: str = "-"  # printed where there is no mean


@dataclass(frozen=True)
class Row:
    """The scores of a method or of its best samples, or of a stage of an error budget."""

    label: str
    scores: Mapping[str, Score]  # by column, where there is a value
    marks: str = ""  # of privileged inputs
    num_clips: int = 0  # only methods with scores on all clips compete
    is_oracle_selected: bool = False  # by the real future; such methods compete with each other
    protocol: str = ""  # the id of the protocol that it was computed under


@dataclass(frozen=True)
class Table:
    """Rows and columns with the notes that explain them."""

    name: str  # of the files
    title: str
    columns: Sequence[Column]
    rows: Sequence[Row]
    notes: Sequence[str] = ()
    marked: Collection[tuple[str, str]] = ()  # (row, column) in bold; differences with a star
    spread: str = "interval"  # or "standard-error"
    has_differences: bool = False  # of another method

    @property
    def is_over_drives(self) -> bool:
        """Return whether intervals treat each drive as one observation."""
        return any(s.is_over_drives for row in self.rows for s in row.scores.values())

    def clips(self, row: Row) -> str:
        """Return the number of clips, and the effective one in the first column if smaller."""
        score = row.scores.get(self.columns[0].key) if self.columns else None
        if score is None or score.effective_clips >= row.num_clips - 0.5:
            return str(row.num_clips or "-")
        return f"{row.num_clips} ({score.effective_clips:.0f})"

    def texts(self, row: Row, column: Column, bold: str = "{}") -> tuple[str, str]:
        """Return the mean, and the interval or standard error with a differing number of clips."""
        score, digits = row.scores.get(column.key), column.digits
        if score is None or np.isnan(score.mean):
            return column.missing, ""
        # "z" prints a negative number that is rounded to zero without its sign.
        mean = f"{score.mean:{'+' if self.has_differences else ''}z{digits}}"
        if (row.label, column.key) in self.marked:
            mean = ("{}*" if self.has_differences else bold).format(mean)
        error = ""
        if self.spread == "interval" and np.isfinite(score.low):
            error = f" [{score.low:z{digits}}, {score.high:z{digits}}]"
        if self.spread == "standard-error" and np.isfinite(score.standard_error):
            error = f" ± {score.standard_error:{digits}}"
        return mean, error if score.clips == row.num_clips else f"{error} (n={score.clips})"


def selected_columns(names: Sequence[str], columns: Sequence[str]) -> Sequence[str]:
    """Return the names of columns; raise BadData for an unknown one."""
    for name in names:
        if name not in columns:
            raise BadData(f"--metrics: no column is called {name!r}{nearest(name, columns)}")
    return names


def best(
    rows: Sequence[Row], columns: Sequence[Column], clips: Sequence[str]
) -> set[tuple[str, str]]:
    """Return (row, column) where no method with the same or fewer inputs is better.

    A method without such a rival is not in bold, nor is one where there are too few clips to tell.
    """
    bold = set()
    for column in (column for column in columns if column.higher_is_better is not None):
        key, sign = column.key, 1.0 if column.higher_is_better else -1.0
        scored = [row for row in rows if len(clips) == row.num_clips and key in row.scores]
        tested: list[tuple[Row, list[Score]]] = []  # rows and the rivals with better means
        for row in scored:
            score = row.scores[key]
            rivals = [
                rival.scores[key]
                for rival in scored
                if rival is not row
                and set(rival.marks) <= set(row.marks)
                and rival.is_oracle_selected == row.is_oracle_selected
            ]
            better = [rival for rival in rivals if sign * rival.mean > sign * score.mean]
            has_few_clips = any(each.has_few_clips for each in (score, *better))
            # a positive error is worse than none, which needs no test
            is_beaten = sign < 0 and any(rival.is_exact for rival in better)
            if rivals and not has_few_clips and not is_beaten:
                tested.append((row, better))
        # Nobody is better with p < .05 after Holm's procedure over the better means.
        pairs = [(rival, row.scores[key]) for row, better in tested for rival in better]
        gaps = iter(Intervals().differences(pairs, clips, has_ends=False))
        for row, better in tested:
            if not any(holm([next(gaps) for _ in better])):
                bold.add((row.label, key))
    return bold
