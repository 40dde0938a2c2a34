"""The log of a training run as CSV, one number per row: step, seconds, split, name, value."""

import csv
from collections.abc import Mapping
from pathlib import Path

COLUMNS = ("step", "seconds", "split", "name", "value")


def truncate(file: Path, step: int) -> None:
    """Keep the rows up to the step from which a run goes on, or begin a new file."""
    rows = read(file) if file.is_file() else []
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w", newline="") as out:
        csv.writer(out).writerow(COLUMNS)
        csv.writer(out).writerows(
            [row[name] for name in COLUMNS] for row in rows if int(row["step"]) <= step
        )


def append(file: Path, step: int, seconds: float, split: str, numbers: Mapping[str, float]) -> None:
    """Append a row per number."""
    with file.open("a", newline="") as out:
        csv.writer(out).writerows(
            [step, f"{seconds:.1f}", split, name, f"{v:.6g}"] for name, v in numbers.items()
        )


def read(file: Path) -> list[dict[str, str]]:
    """Read the rows of a log, without a truncated last one."""
    with file.open(newline="") as rows:
        return [
            row
            for row in csv.DictReader(rows)
            if row.get("value") and (row.get("step") or "").isdecimal()
        ]
