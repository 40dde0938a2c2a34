"""Findings about files: a loader raises the first error, the doctor lists all of them."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from geovp_classic.errors import BadData


@dataclass(frozen=True)
class Finding:
    """What was found where; an error stops a loader, a warning and a note do not."""

    path: Path
    line: int | None  # the first line of a file is 1
    severity: Literal["error", "warning", "note"]
    message: str

    def __str__(self) -> str:
        return (
            f"{self.path} line {self.line}: {self.message}"
            if self.line
            else f"{self.path}: {self.message}"
        )


def error(path: Path, line: int | None, message: str) -> Finding:
    """A finding that stops a loader."""
    return Finding(path, line, "error", message)


def raise_first(findings: Iterable[Finding]) -> None:
    """Raise BadData for the first error, if there is one."""
    for finding in findings:
        if finding.severity == "error":
            raise BadData(str(finding))
