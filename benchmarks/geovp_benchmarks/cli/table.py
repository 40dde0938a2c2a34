"""Print and write the tables of a results folder."""

from __future__ import annotations

import argparse
import dataclasses
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from geovp_benchmarks.arguments import add_choice, add_division, add_json, add_results_folder
from geovp_benchmarks.cli.messages import width
from geovp_classic.errors import BadData

if TYPE_CHECKING:
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.tables.table_model import Table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which results, and how they are printed."""
    add_results_folder(parser)
    add_division(parser)
    parser.add_argument(
        "--format", choices=("md", "tex", "csv"), default="md", help="what is printed (default: md)"
    )
    add_json(parser)
    parser.add_argument(
        "--against", metavar="METHOD", help="print paired differences of all methods from this one"
    )
    parser.add_argument(
        "--strict", action="store_true", help="leave out clips that a method could not predict"
    )
    parser.add_argument(
        "--spread",
        choices=("interval", "standard-error"),
        default="interval",
        help="behind each mean: its 95 %% interval, or the standard error over clips as if they "
        "were independent",
    )
    parser.add_argument(
        "--style",
        choices=("suite", "thesis"),
        default="suite",
        help="thesis: as its table 4.1, in md or tex",
    )
    add_choice(parser)
    parser.add_argument(
        "--label",
        metavar="NAME",
        help="of the LaTeX table, for \\ref; further tables get NAME-2 ...",
    )
    parser.add_argument(
        "--caption", metavar="TEXT", help="of the LaTeX table, taken as LaTeX (default: its title)"
    )
    parser.add_argument(
        "--page",
        type=Path,
        metavar="FILE.md",
        help="write what is printed as a page of the docs, too",
    )
    parser.add_argument(
        "--command",
        metavar="TEXT",
        help="what the page says computed the methods (default: geovp run)",
    )


def run(chosen: argparse.Namespace) -> int:
    """Print in one format, write in all; the main table of each kind of clips is printed only."""
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.running import multiple_datasets
    from geovp_benchmarks.tables import formats

    if chosen.page is not None and chosen.format != "md":
        raise BadData(f"--page is written as md alone, not as {chosen.format}: leave --format out")
    if chosen.json and (
        chosen.page is not None or chosen.format != "md" or chosen.style != "suite"
    ):
        raise BadData("--json prints numbers alone: leave --page, --format and --style out")
    results = Results(chosen.folder)
    parts = results.by_dataset()
    if len(parts) > 1 and chosen.page is not None:
        raise BadData(
            f"--page is of one data set, {chosen.folder} holds {', '.join(parts)}: give the "
            "folder of one"
        )
    if chosen.json:
        print(
            formats.as_json([table for part in parts.values() for table in _tables(chosen, part)])
        )
        return 0
    columns = None if chosen.page is not None else width()
    text = "\n".join(_text(chosen, part, columns) for part in parts.values())
    if len(parts) > 1 and chosen.format == "md" and chosen.by is None and chosen.against is None:
        text = f"{text}\n{multiple_datasets.side_by_side(results, columns)}"
    print(text)
    if chosen.page is not None:
        protocol = results.protocol()
        versions = ", ".join(
            f"{package} {version}" for package, version in protocol["versions"].items()
        )
        commands = [chosen.command or f"geovp run {protocol['name']}", _own_command(chosen)]
        origin = f"`geovp table --page`; computed with {versions}"
        formats.write_page(chosen.page, protocol["name"], commands, origin, text)
    return 0


def _text(chosen: argparse.Namespace, results: Results, columns: int | None) -> str:
    """What is printed, in Markdown no wider than so many columns."""
    from geovp_benchmarks.analysis import strata
    from geovp_benchmarks.tables import formats, published

    _check(chosen)
    if chosen.style == "thesis":
        parts = [results] if chosen.by is None else strata.divide(results, chosen.by)
        shown = [table for part in parts for table in published.build(part, "thesis")]
        return "\n".join(map(formats.FORMATS[chosen.format], shown))
    shown = _labelled(_tables(chosen, results), chosen.label, chosen.caption)
    if chosen.format == "md":
        return "\n".join(formats.markdown(table, columns) for table in shown)
    return "\n".join(map(formats.FORMATS[chosen.format], shown))


def _tables(chosen: argparse.Namespace, results: Results) -> list[Table]:
    """The tables of one data set; where nothing else is asked for, they are written as well."""
    from geovp_benchmarks.analysis import strata
    from geovp_benchmarks.tables import formats, tables
    from geovp_benchmarks.tables.table_model import EVERYTHING, Choice

    choice = Choice(tuple(chosen.methods), tuple(chosen.metrics))
    parts = [results] if chosen.by is None else strata.divide(results, chosen.by)
    if chosen.against is not None:
        return [
            tables.against(part, chosen.against, strict=chosen.strict, choice=choice)
            for part in parts
        ]
    built = [
        tables.build(part, chosen.spread, strict=chosen.strict, choice=choice) for part in parts
    ]
    if chosen.by is not None:
        return [main for main, *_ in built]
    usual = chosen.spread == "interval" and not chosen.strict and choice == EVERYTHING
    formats.write_all(results, built[0] if usual else tables.build(results))
    return built[0]


def _check(chosen: argparse.Namespace) -> None:
    if chosen.style == "thesis" and (
        chosen.methods or chosen.metrics or chosen.label or chosen.caption
    ):
        raise BadData(
            "--style thesis has the thesis's methods and columns: leave --methods, --metrics and "
            "the like out"
        )
    if chosen.format != "tex" and (chosen.label or chosen.caption):
        raise BadData(
            f"--label and --caption are LaTeX's, not for {chosen.format}: add --format tex"
        )
    if chosen.label and not re.fullmatch(r"[\w:./+-]+", chosen.label):
        raise BadData(
            f"--label {chosen.label!r} is not a name for LaTeX: use letters, digits and : . / + "
            "- _ alone"
        )


def _labelled(tables: Sequence[Table], label: str | None, caption: str | None) -> list[Table]:
    """Every table with a label of its own; the first has the caption."""
    labels = [label or f"tab:{table.name}" for table in tables]
    numbered = [
        f"{one}-{labels[:at].count(one) + 1}" if one in labels[:at] else one
        for at, one in enumerate(labels)
    ]
    captions = [caption or "", *[""] * len(tables)]
    return [
        dataclasses.replace(table, label=name, caption=words)
        for table, name, words in zip(tables, numbered, captions, strict=False)
    ]


def _own_command(chosen: argparse.Namespace) -> str:
    """The command line that prints the same tables again."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    options = ("by", "against", "spread", "style", "methods", "metrics")
    given = {option: getattr(chosen, option) for option in options}
    words = [
        f"--{option} {shlex.join([value] if isinstance(value, str) else value)}"
        for option, value in given.items()
        if value != parser.get_default(option)
    ]
    return " ".join(
        [
            "geovp table",
            f"results/{chosen.folder.resolve().name}",
            *words,
            *["--strict"] * chosen.strict,
        ]
    )
