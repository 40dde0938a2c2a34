"""Print and write the tables of a results folder."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from geovp_benchmarks.arguments import add_division, add_json, add_results_folder
from geovp_benchmarks.cli.messages import width
from geovp_classic.errors import BadData

if TYPE_CHECKING:
    from geovp_benchmarks.store import Results
    from geovp_benchmarks.table_model import Table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which results, and how they are printed."""
    add_results_folder(parser)
    add_division(parser)
    parser.add_argument("--format", choices=("md", "tex", "csv"), default="md", help="what is printed (default: md)")
    add_json(parser)
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
    parser.add_argument("--page", type=Path, metavar="FILE.md", help="write what is printed as a page of the docs, too")
    parser.add_argument("--command", metavar="TEXT", help="what the page says computed the rows (default: geovp run)")


def run(chosen: argparse.Namespace) -> int:
    """Print in one format, write in all; the main table of each kind of clips is printed only."""
    from geovp_benchmarks import formats, multiple_datasets
    from geovp_benchmarks.store import Results
    from geovp_classic.data.atomic import write_bytes

    if chosen.page is not None and chosen.format != "md":
        raise BadData(f"--page is written as md alone, not as {chosen.format}: leave --format out")
    if chosen.json and (chosen.page is not None or chosen.format != "md" or chosen.style != "suite"):
        raise BadData("--json prints numbers alone: leave --page, --format and --style out")
    results = Results(chosen.folder)
    parts = results.by_dataset()
    if len(parts) > 1 and chosen.page is not None:
        raise BadData(f"--page is of one data set, {chosen.folder} holds {', '.join(parts)}: give the folder of one")
    if chosen.json:
        print(formats.as_json([table for part in parts.values() for table in _tables(chosen, part)]))
        return 0
    columns = None if chosen.page is not None else width()
    text = "\n".join(_text(chosen, part, columns) for part in parts.values())
    if len(parts) > 1 and chosen.format == "md" and chosen.by is None and chosen.against is None:
        text = f"{text}\n{multiple_datasets.side_by_side(results, columns)}"
    print(text)
    if chosen.page is not None:
        before = chosen.page.read_text(encoding="utf-8") if chosen.page.exists() else ""
        commands = [chosen.command or formats.default_command(results.protocol()), _own_command(chosen)]
        write_bytes(chosen.page, formats.page(text, results.protocol(), commands, before).encode())
    return 0


def _text(chosen: argparse.Namespace, results: Results, columns: int | None) -> str:
    """What is printed, in Markdown no wider than so many columns."""
    from geovp_benchmarks import formats, strata, thesis

    if chosen.style == "thesis":
        if chosen.format not in thesis.FORMATS:
            raise BadData(f"--style thesis is written as {' or '.join(thesis.FORMATS)}, not as {chosen.format}")
        parts = [results] if chosen.by is None else strata.divide(results, chosen.by)
        return "\n".join(map(thesis.FORMATS[chosen.format], parts))
    shown = _tables(chosen, results)
    if chosen.format == "md":
        return "\n".join(formats.markdown(table, columns) for table in shown)
    return "\n".join(map(formats.FORMATS[chosen.format], shown))


def _tables(chosen: argparse.Namespace, results: Results) -> list[Table]:
    """The tables of one data set; where nothing else is asked for, they are written as well."""
    from geovp_benchmarks import formats, strata, tables

    parts = [results] if chosen.by is None else strata.divide(results, chosen.by)
    if chosen.against is not None:
        return [tables.against(part, chosen.against, strict=chosen.strict) for part in parts]
    built = [tables.build(part, chosen.spread, strict=chosen.strict) for part in parts]
    if chosen.by is not None:
        return [main for main, *_ in built]
    formats.write_all(results)
    return built[0]


def _own_command(chosen: argparse.Namespace) -> str:
    """The command line that prints the same tables again."""
    defaults = {"by": None, "against": None, "spread": "interval", "style": "suite"}
    given = {option: getattr(chosen, option) for option, default in defaults.items()}
    words = [f"--{option} {shlex.quote(value)}" for option, value in given.items() if value != defaults[option]]
    return " ".join(["geovp table", f"results/{chosen.folder.resolve().name}", *words, *["--strict"] * chosen.strict])
