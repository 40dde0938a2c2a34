"""Findings about files: a loader raises the first error, the doctor lists all of them.

Text files are read here, because each of their lines may be wrong.
"""

import contextlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray

Severity = Literal["error", "warning", "note"]
# between images: 1000 Hz, and less than a time in milliseconds would be at 100 Hz
MIN_STEP_S, MAX_STEP_S = 0.001, 5.0
PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


@dataclass(frozen=True)
class FileFinding:
    """An observation about a file; an error stops a loader, a warning or a note does not."""

    path: Path
    line: int | None  # the first line of a file is 1
    severity: Severity
    message: str

    def __str__(self) -> str:
        line = f" line {self.line}" if self.line else ""
        return f"{self.path}{line}: {self.message}"


class BadFile(BadData):
    """A finding that is raised."""

    def __init__(self, finding: FileFinding) -> None:
        super().__init__(str(finding))
        self.finding = finding


class Findings(list[FileFinding]):
    """A list that reading functions add their findings to."""

    def add(
        self,
        path: Path,
        message: str,
        line: int | None = None,
        severity: Severity = "error",
    ) -> None:
        """Add a finding about a line of a file, or about a file or folder as a whole."""
        self.append(FileFinding(path, line, severity, message))

    @contextlib.contextmanager
    def catch(self, path: Path, line: int | None = None) -> Iterator[None]:
        """Add the BadData that is raised about a file, or about a line of it, as an error."""
        try:
            yield
        except BadFile as problem:
            self.append(problem.finding)
        except BadData as problem:
            message = str(problem)
            for prefix in (f"{path}: ", f"{path} "):  # but not that of a file below the path
                message = message.removeprefix(prefix)
            self.add(path, message, line)

    def lines(self, path: Path) -> list[tuple[int, str]]:
        """Read the numbers, from 1, and texts of the lines that hold more than a comment (#).

        A header, the first line if no word of it is or begins as a number, is left out.
        """
        lines = []
        with self.catch(path):
            if not path.exists():
                raise BadData("does not exist")
            for number, line in enumerate(files.read_text(path).splitlines(), 1):
                if text := line.partition("#")[0].strip():
                    lines.append((number, text))
            if lines and not re.search(r"(?i)(^|[\s,;])([-+.\d]|(nan|inf)\b)", lines[0][1]):
                del lines[0]
            if not lines:
                raise BadData("has no numbers")
        return lines

    def parse(
        self,
        path: Path,
        parse_line: Callable[[str], tuple[Any, Any]],
        missing: tuple[Any, Any] | None = None,
    ) -> tuple[list[Any], list[Any]]:
        """Parse lines to keys [N], which must increase, and values [N].

        `parse_line` raises BadData for a bad line, in whose place `missing` is returned if it is
        given.
        """
        pairs = []
        last = None
        for number, text in self.lines(path):
            pair = missing
            with self.catch(path, number):
                key, value = parse_line(text)
                if last is not None and key <= last:
                    raise BadData(f"{key} is not after {last} before it")
                last = key
                pair = key, value
            if pair is not None:
                pairs.append(pair)
        return [key for key, _ in pairs], [value for _, value in pairs]

    def check_steps(self, path: Path, stamps: FloatArray, unit: str = "s") -> None:
        """Add an error unless stamps [N] of a unit come at a rate that cameras have."""
        steps = np.diff(stamps[np.isfinite(stamps)])
        if not len(steps):
            return
        usual = float(np.median(steps))
        units = [
            name for name, per_s in PER_SECOND.items() if MIN_STEP_S <= usual / per_s <= MAX_STEP_S
        ]
        if unit not in units:
            self.add(
                path,
                f"the usual step between times is {usual:.6g}, as of times in "
                f"{' or '.join(units) or 'no unit'}: give times in {unit}, {MIN_STEP_S} to "
                f"{MAX_STEP_S:g} s apart",
            )


class FirstError(Findings):
    """Findings that raise an error, as a BadFile, instead of collecting it."""

    def append(self, finding: FileFinding) -> None:
        """Raise an error; ignore warnings and notes."""
        if finding.severity == "error":
            raise BadFile(finding)


RAISE = FirstError()


def words(text: str, max_splits: int = 0) -> list[str]:
    """Split a line at spaces, tabs, commas and semicolons, at most `max_splits` times if not 0."""
    return re.split(r"[\s,;]+", text.strip(" \t,;"), maxsplit=max_splits)


def parse_numbers(text: str, *counts: int) -> FloatArray:
    """Return the finite numbers of a line, as many as one of `counts`; BadData otherwise."""
    numbers = words(text)
    for word in numbers:
        try:
            number = float(word)
        except ValueError:
            number = np.nan
        # nanoseconds since 1970 are below 2^63; float() accepts 1_0 for 10
        if not abs(number) < 2.0**63 or not word.isascii() or "_" in word:
            raise BadData(f"{word[:40]!r} is not a finite number")
    if len(numbers) not in counts:
        expected = " or ".join(map(str, counts))
        has_decimal_commas = len(numbers) > max(counts) and "." not in text and "," in text
        advice = ": write decimals with a point, not with a comma" if has_decimal_commas else ""
        raise BadData(f"{len(numbers)} numbers, expected {expected}{advice}")
    return np.array(numbers, np.float64)
