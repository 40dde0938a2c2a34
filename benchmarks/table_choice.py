"""Which rows and columns a table shows, and in which order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from geovp_benchmarks.store import Cell
from geovp_benchmarks.table_model import Row
from geovp_classic.errors import BadData
from geovp_classic.registry import nearest


@dataclass(frozen=True)
class Choice:
    """Rows and columns in the order asked for; all, as the matrix has them, where none are named."""

    methods: tuple[str, ...] = ()  # rows as tables name them; a method's name stands for all of its rows
    metrics: tuple[str, ...] = ()  # columns: "psnr", "psnr@covered", "coverage"

    def cells(self, cells: Sequence[Cell]) -> list[Cell]:
        """The cells of the chosen rows; BadData when a name is none of theirs."""
        found = {}
        for name in self.methods:
            own = [cell for cell in cells if _is_of(name, cell.label)]
            if not own:
                labels = [cell.label for cell in cells]
                raise BadData(f"no row is called {name!r}{nearest(name, labels)}; known are {', '.join(labels)}")
            found.update({cell.name: cell for cell in own})
        return [*found.values()] if self.methods else list(cells)

    def rows(self, rows: Sequence[Row]) -> list[Row]:
        """The chosen ones of the chosen cells' rows, each once; BadData when a name is none of theirs."""
        if not self.methods:
            return list(rows)
        found = {}
        for name in self.methods:
            found.update({row.name: row for row in rows if row.name == name or _is_of(row.name, name)})
        if not found:
            known = ", ".join(row.name for row in rows) or "none: see below the table why"
            raise BadData(f"--methods {', '.join(self.methods)}: no such row; known with scores are {known}")
        return [*found.values()]

    def columns(self, metrics: Iterable[str], keys: Iterable[str]) -> list[str]:
        """The chosen columns, none where all are meant; BadData when a name is none of them."""
        known = [*dict.fromkeys([*metrics, *keys])]
        for name in self.metrics:
            if name not in known:
                raise BadData(f"--metrics: no column is called {name!r}{nearest(name, known)}")
        return [*dict.fromkeys(self.metrics)]

    def including(self, row: str) -> Choice:
        """The choice with a row that others are compared with."""
        return replace(self, methods=(row, *self.methods)) if self.methods else self


EVERYTHING = Choice()


def _is_of(name: str, label: str) -> bool:
    """Whether a row's name is a method's label, or that with how its samples were reduced behind."""
    return name == label or name.startswith(f"{label}, ")
