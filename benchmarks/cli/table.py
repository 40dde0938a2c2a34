"""Print and write the tables of a results folder."""

from __future__ import annotations

import argparse

from benchmarks.arguments import add_results_folder
from geovp_classic.errors import BadData


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which results, and how they are printed."""
    add_results_folder(parser)
    parser.add_argument("--format", choices=("md", "tex", "csv"), default="md", help="what is printed (default: md)")
    parser.add_argument("--against", metavar="ROW", help="print paired differences of all rows from this one")
    parser.add_argument("--strict", action="store_true", help="leave out clips that a method could not predict")
    parser.add_argument(
        "--spread",
        choices=("interval", "standard-error"),
        default="interval",
        help="behind each mean: its 95 %% interval, or the standard error over clips as if they were independent",
    )
    parser.add_argument("--style", choices=("suite", "thesis"), default="suite", help="thesis: as its table 4.1, in md")


def run(chosen: argparse.Namespace) -> int:
    """Print in one format, write in all."""
    from benchmarks import formats, tables, thesis
    from benchmarks.store import Results

    results = Results(chosen.folder)
    if chosen.style == "thesis":
        if chosen.format != "md":
            raise BadData(f"--style thesis is written as md alone, not as {chosen.format}: leave --format out")
        print(thesis.markdown(results))
        return 0
    if chosen.against is not None:
        print(formats.FORMATS[chosen.format](tables.against(results, chosen.against, strict=chosen.strict)))
        return 0
    for table in tables.build(results, chosen.spread, strict=chosen.strict):
        print(formats.FORMATS[chosen.format](table))
    formats.write_all(results)
    return 0
