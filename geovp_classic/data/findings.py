"""One thing that is wrong, or worth knowing, about a file: loaders raise the first, the doctor lists them all."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from geovp_classic.errors import BadData

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """What was found where; an error stops a loader, a warning and a note do not."""

    path: Path
    line: int | None  # the first line of a file is 1
    severity: Severity
    message: str

    def __str__(self) -> str:
        """The file, the line where there is one, and what is the matter."""
        return f"{self.path} line {self.line}: {self.message}" if self.line else f"{self.path}: {self.message}"


def error(path: Path, line: int | None, message: str) -> Finding:
    """A finding that stops a loader."""
    return Finding(path, line, "error", message)


def raise_first(findings: Iterable[Finding]) -> None:
    """BadData of the first error, if there is one."""
    for finding in findings:
        if finding.severity == "error":
            raise BadData(str(finding))
