"""Print and write the tables of a results folder."""

from __future__ import annotations

import argparse

from benchmarks.arguments import add_division, add_results_folder
from geovp_classic.errors import BadData


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which results, and how they are printed."""
    add_results_folder(parser)
    add_division(parser)
    parser.add_argument("--format", choices=("md", "tex", "csv"), default="md", help="what is printed (default: md)")
    parser.add_argument("--against", metavar="ROW", help="print paired differences of all rows from this one")
    parser.add_argument("--strict", action="store_true", help="leave out clips that a method could not predict")
    parser.add_argument(
        "--spread",
        choices=("interval", "standard-error"),
        default="interval",
        help="behind each mean: its 95 %% interval, or the standard error over clips as if they were independent",
    )
    parser.add_argument(
        "--style", choices=("suite", "thesis"), default="suite", help="thesis: as its table 4.1, in md or tex"
    )


def run(chosen: argparse.Namespace) -> int:
    """Print in one format, write in all; the main table of each kind of clips is printed only."""
    from benchmarks import formats, strata, tables, thesis
    from benchmarks.store import Results

    results = Results(chosen.folder)
    parts = [results] if chosen.by is None else strata.divide(results, chosen.by)
    if chosen.style == "thesis":
        if chosen.format not in thesis.FORMATS:
            raise BadData(f"--style thesis is written as {' or '.join(thesis.FORMATS)}, not as {chosen.format}")
        print(*map(thesis.FORMATS[chosen.format], parts), sep="\n")
        return 0
    render = formats.FORMATS[chosen.format]
    if chosen.against is not None:
        print(*(render(tables.against(part, chosen.against, strict=chosen.strict)) for part in parts), sep="\n")
        return 0
    built = [tables.build(part, chosen.spread, strict=chosen.strict) for part in parts]
    if chosen.by is not None:
        print(*(render(main) for main, *_ in built), sep="\n")
        return 0
    print(*map(render, built[0]), sep="\n")
    formats.write_all(results)
    return 0
