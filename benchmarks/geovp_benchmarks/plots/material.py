"""The data that all figures of a results folder share, and a drawn figure."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from matplotlib.figure import Figure

from geovp_benchmarks.plots import style
from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.store import Cell, Results, Rows
from geovp_benchmarks.tables.table_model import EVERYTHING, Choice


@dataclass(frozen=True)
class Page:
    """One figure, ready to be written."""

    name: str  # of the file, without its ending
    kind: str  # "horizon", "samples", "strip", "inpainted" or "paths"
    subject: str  # the metric or the clip
    caption: str
    figure: Figure
    formats: tuple[str, ...]


@dataclass(frozen=True)
class Material:
    """The results that all figures are drawn from."""

    results: Results
    protocol: Mapping[str, Any]
    cells: Sequence[Cell]  # with rows
    rows: Mapping[str, Rows]  # by cell
    step_s: float | None  # seconds from one horizon step to the next, None where clips differ

    @classmethod
    def read(cls, results: Results, choice: Choice = EVERYTHING) -> Self:
        """Read everything but images.

        BadData when the folder holds no results, or no method that was chosen.
        """
        protocol = results.protocol()
        cells = choice.cells(results.cells())
        ran = [cell for cell in cells if cell.status in ("done", "partial")]
        rows = {cell.name: results.scores(cell.name) for cell in ran}
        cells = [cell for cell in ran if len(rows[cell.name])]
        return cls(results, protocol, cells, rows, _step_s(results, protocol["num_past"]))

    @property
    def data(self) -> str:
        """The data set and its split, for people."""
        return stored_facts.data_name(self.protocol)


def title(metric: str) -> str:
    """A metric's name as a heading."""
    name = stored_facts.title(metric)
    return name[:1].upper() + name[1:]


def numbered(
    kind: str,
    name: str,
    subject: str,
    heading: style.Heading,
    figures: Sequence[Figure],
    formats: tuple[str, ...] = ("png", "svg"),
) -> list[Page]:
    """The pages of one plot; `name` may hold any letters."""
    stem = f"{kind}-{re.sub('[^A-Za-z0-9]+', '-', name).strip('-').lower()}"
    caption = f"{heading.title}. {heading.subtitle}."
    many = len(figures) > 1
    return [
        Page(stem + f"-{n}" * many, kind, subject, caption, figure, formats)
        for n, figure in enumerate(figures, 1)
    ]


def _step_s(results: Results, num_past: int) -> float | None:
    """The seconds between two horizon steps, from the kept clips; None when they differ by more
    than a tenth.
    """
    clips = [results.clip(name) for name, _ in results.clips()]
    steps_s = [np.diff(clip.times_s[num_past - 1 :]).mean() for clip in clips]
    if not steps_s or max(steps_s) > 1.1 * min(steps_s):
        return None
    return float(np.mean(steps_s))
