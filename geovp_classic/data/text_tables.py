"""Text files of numbers, read row by row with the line that each row stands on."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from geovp_classic.data.findings import Finding, error
from geovp_classic.errors import BadData


@dataclass(frozen=True)
class Row:
    """The numbers of one line, all finite."""

    line: int
    numbers: tuple[float, ...]


def read_lines(path: Path) -> tuple[list[tuple[int, str]], list[Finding]]:
    """(line number, text) of every line that says something; blank lines and what follows a # are left out."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return [], [error(path, None, "does not exist")]
    except (OSError, UnicodeDecodeError) as problem:
        return [], [error(path, None, f"cannot be read as text ({problem})")]
    lines = [(number, line.partition("#")[0].strip()) for number, line in enumerate(text.splitlines(), start=1)]
    return [(number, line) for number, line in lines if line], []


def read_rows(path: Path) -> tuple[list[Row], list[Finding]]:
    """The rows of numbers, and a finding for every line that holds anything else."""
    lines, findings = read_lines(path)
    rows = []
    for number, line in lines:
        row = parse_row(path, number, line)
        if isinstance(row, Row):
            rows.append(row)
        else:
            findings.append(row)
    return rows, findings


def parse_row(path: Path, number: int, text: str) -> Row | Finding:
    """The numbers of one line, or what is wrong with it."""
    numbers = []
    for word in text.split():
        try:
            value = float(word)
        except ValueError:
            return error(path, number, f"{word!r} is not a number")
        if not math.isfinite(value):
            return error(path, number, f"{word!r} is not finite: every number must be known")
        numbers.append(value)
    return Row(number, tuple(numbers))


def write_lines(path: Path, lines: Iterable[str]) -> None:
    """Write beside and rename into place, so that nobody ever reads half a file; BadData when that cannot be done."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        beside.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        os.replace(beside, path)
    except OSError as problem:
        beside.unlink(missing_ok=True)
        raise BadData(
            f"{path} cannot be written ({problem.strerror}): give a file in a folder that exists"
        ) from problem
