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
    """Print what differs, then the paired differences."""
    from geovp_benchmarks.tables import explanation

    (a, row_a), (b, row_b) = _parsed(chosen.a), _parsed(chosen.b)
    found = explanation.pairs(a, b, row_a, row_b)
    common = list(explanation.shared(*found[0]))
    print(f"A: {chosen.a}\nB: {chosen.b}", *common, sep="\n")
    for one, other in found:
        own = list(explanation.own(one, other))
        names = (
            one.method.label
            if one.method.label == other.method.label
            else f"{one.method.label} (A), {other.method.label} (B)"
        )
        print(
            f"\n{names}",
            *([] if common or own else ["Nothing differs that is stored."]),
            *own,
            sep="\n",
        )
        print(*explanation.differences(one, other), sep="\n")
    return 0


def _parsed(text: str) -> tuple[Results, str]:
    """The folder, and the row behind its last colon or ""."""
    from geovp_benchmarks.results.store import Results

    folder, colon, row = text.rpartition(":")
    if not colon or Path(text).exists():
        return Results(Path(text)), ""
    return Results(Path(folder)), row
