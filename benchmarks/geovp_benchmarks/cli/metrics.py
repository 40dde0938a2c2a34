"""Questions about stored numbers: `explain A B` says why two of them differ."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geovp_benchmarks.results.store import Results


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which question, and which numbers."""
    questions = parser.add_subparsers(metavar="QUESTION", required=True)
    explain = questions.add_parser(
        "explain", help="why the numbers of two results folders, or of two methods, differ"
    )
    for name in "AB":
        explain.add_argument(
            name.lower(), metavar=name, help="a results folder, or DIR:METHOD for a method"
        )


def run(chosen: argparse.Namespace) -> int:
    """Print what differs, and paired differences for each method."""
    from geovp_benchmarks.tables.comparison import compare

    (a, method_a), (b, method_b) = _parsed(chosen.a), _parsed(chosen.b)
    print(f"A: {chosen.a}\nB: {chosen.b}", *compare(a, b, method_a, method_b), sep="\n")
    return 0


def _parsed(text: str) -> tuple[Results, str]:
    """The folder, and the row behind its last colon or ""."""
    from geovp_benchmarks.results.store import Results

    folder, colon, row = text.rpartition(":")
    if not colon or Path(text).exists():
        return Results(Path(text)), ""
    return Results(Path(folder)), row
