"""A training run's numbers as CSV, one a row: step, seconds, split, name, value."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

COLUMNS = ("step", "seconds", "split", "name", "value")


class TrainingLog:
    """Appends to a file, after taking out what was written behind the step from which the run goes on."""

    def __init__(self, file: Path, step: int) -> None:
        """Keep the rows of a file up to `step`; begin a new one where there is none."""
        self._file = file
        rows = read(file) if file.is_file() else []
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("w", newline="") as out:
            writer = csv.writer(out)
            writer.writerow(COLUMNS)
            writer.writerows([row[name] for name in COLUMNS] for row in rows if int(row["step"]) <= step)

    def write(self, step: int, seconds: float, split: str, numbers: Mapping[str, float]) -> None:
        """One row for every number."""
        with self._file.open("a", newline="") as out:
            csv.writer(out).writerows([step, f"{seconds:.1f}", split, name, f"{v:.6g}"] for name, v in numbers.items())


def read(file: Path) -> list[dict[str, str]]:
    """The whole rows of a log; a last row that a kill cut short is left out."""
    with file.open(newline="") as rows:
        return [row for row in csv.DictReader(rows) if row.get("value") and (row.get("step") or "").isdecimal()]
