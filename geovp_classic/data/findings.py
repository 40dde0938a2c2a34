"""Findings about files: a loader raises the first error, the doctor lists all of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from geovp_classic.errors import BadData


@dataclass(frozen=True)
class Finding:
    """An observation about a file; an error stops a loader, a warning or a note does not."""

    path: Path
    line: int | None  # the first line of a file is 1
    severity: Literal["error", "warning", "note"]
    message: str

    def __str__(self) -> str:
        place = f"{self.path} line {self.line}" if self.line else str(self.path)
        return f"{place}: {self.message}"


class Findings(list[Finding]):
    """A list that scanning functions add their findings to."""

    def error(self, path: Path, message: str, line: int | None = None) -> None:
        """Add an error in a line of a file, or in the file as a whole."""
        self.append(Finding(path, line, "error", message))

    def warn(self, path: Path, message: str) -> None:
        """Add a warning about a file or folder."""
        self.append(Finding(path, None, "warning", message))

    def note(self, path: Path, message: str) -> None:
        """Add a note about a file or folder."""
        self.append(Finding(path, None, "note", message))

    def add(self, path: Path, problem: BadData) -> None:
        """Add an exception about a file as an error."""
        self.error(path, str(problem).removeprefix(str(path)).lstrip(": "))

    def raise_first(self) -> None:
        """Raise BadData for the first error, if there is one."""
        for finding in self:
            if finding.severity == "error":
                raise BadData(str(finding))
