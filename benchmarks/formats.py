"""Tables as Markdown and CSV, and in every format."""

from __future__ import annotations

import csv
import datetime
import io
import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geovp_benchmarks import tables
from geovp_benchmarks.latex import latex
from geovp_benchmarks.store import Results
from geovp_benchmarks.table_model import Column, Row, Table
from geovp_classic.data.atomic import write_bytes

NOTES = "## Notes\n"  # from this line on, a page is written by hand
CONFIGS = Path(__file__).parent / "configs"
SUFFIXES = ("", "_low", "_high", "_standard_error", "_clips", "_effective_clips")


def write_all(results: Results) -> list[Path]:
    """Write all tables in all formats and return the files."""
    written = []
    for table in tables.build(results):
        for ending, render in FORMATS.items():
            path = results.tables / f"{table.name}.{ending}"
            write_bytes(path, render(table).encode())
            written.append(path)
    return written


def markdown(table: Table) -> str:
    """GitHub's Markdown, columns aligned so that it reads well in a terminal, too."""
    lines = [["method", "clips", *(column.heading for column in table.columns)]]
    for row in table.rows:
        marks = f" [{row.marks}]" if row.marks else ""
        values = [value(table, row, column) for column in table.columns]
        lines.append([row.name + marks, table.clips(row), *values])
    notes = [f"- {note}" for note in table.notes]
    return "\n".join([f"## {table.title}", "", *grid(lines), "", *notes, ""])


def grid(lines: Sequence[Sequence[str]], numbers: bool = True) -> list[str]:
    """A Markdown table of a head and rows; with `numbers`, all columns but the first are aligned on the right."""
    widths = [max(map(len, texts)) for texts in zip(*lines, strict=True)]
    layout = " | ".join(["{:<{}}", *["{:>{}}" if numbers else "{:<{}}"] * (len(widths) - 1)])
    rule = ["-" * widths[0], *("-" * (n - 1) + (":" if numbers else "-") for n in widths[1:])]
    rows = [lines[0], rule, *lines[1:]]
    return [f"| {layout.format(*itertools.chain(*zip(row, widths, strict=True)))} |" for row in rows]


def page(text: str, protocol: Mapping[str, Any], commands: Sequence[str], before: str = "") -> str:
    """A page of the documentation: title, commands, date, versions, tables; the old page's notes stay."""
    versions = ", ".join(f"{package} {version}" for package, version in protocol["versions"].items())
    heading = [f"# {protocol['name']}", "", "```sh", *commands, "```", ""]
    origin = f"Written on {datetime.date.today().isoformat()} by `geovp table --page`; computed with {versions}."
    _, found, kept = before.partition(NOTES)
    return "\n".join([*heading, origin, "", text.rstrip(), "", *([NOTES + kept] if found else [])])


def default_command(protocol: Mapping[str, Any]) -> str:
    """The command that computes the rows of a matrix, which lies among ours or in the current folder."""
    name, _, label = protocol["name"].partition("/")  # a matrix of one of several data sets is FILE/LABEL
    root = " --root path/to/data" if "root" in protocol["dataset"] and not label else ""
    file = f"{name}.toml"
    return f"geovp run {f'benchmarks/configs/{file}' if (CONFIGS / file).exists() else file}{root}"


def comma_separated(table: Table) -> str:
    """Unrounded numbers of each column: mean, interval, standard error, number of clips, effective number."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    names = [f"{column.key}{suffix}" for column in table.columns for suffix in SUFFIXES]
    writer.writerow(["method", "grants", "clips", "protocol", *names])
    for row in table.rows:
        numbers = [_numbers(row, column.key) for column in table.columns]
        texts = (text for group in numbers for text in group)
        writer.writerow([row.name, row.marks, row.num_clips, row.protocol, *texts])
    return stream.getvalue()


def value(table: Table, row: Row, column: Column) -> str:
    """A value as Markdown has it, bold where it is the best."""
    mean, error = table.texts(row, column)
    return (f"**{mean}**" if table.is_best(row, column) else mean) + error


def _numbers(row: Row, key: str) -> list[str]:
    if key not in row.estimates or int(row.estimates[key].count) == 0:
        return ["", "", "", "", "0", ""]
    one, found = row.estimates[key], row.intervals[key]
    numbers = [float(one.mean), found.low, found.high, float(one.error), int(one.count), found.effective]
    return ["" if np.isnan(number) else repr(number) for number in numbers]


def columns(lines: Sequence[Sequence[str]]) -> list[str]:
    """Rows of texts as lines whose columns are aligned on the left."""
    widths = [max(map(len, texts)) for texts in zip(*lines, strict=True)]
    return ["  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip() for line in lines]


FORMATS: dict[str, Callable[[Table], str]] = {"md": markdown, "tex": latex, "csv": comma_separated}
