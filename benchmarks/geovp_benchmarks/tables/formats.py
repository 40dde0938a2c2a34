"""Tables as Markdown and CSV, and in every format."""

import csv
import datetime
import io
import itertools
import json
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geovp_benchmarks.matrix import CONFIGS
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables import tables
from geovp_benchmarks.tables.latex import latex
from geovp_benchmarks.tables.table_model import Column, MethodScores, Table
from geovp_classic.data.atomic import write_bytes

NOTES = "## Notes\n"  # from this line on, a page is written by hand
NUMBERS = ("mean", "low", "high", "standard_error", "clips", "effective_clips")


def write_all(results: Results, built: Sequence[Table] | None = None) -> list[Path]:
    """Write all tables in all formats and return the files; those of `tables.build(results)` can be
    handed over.
    """
    written = []
    for table in tables.build(results) if built is None else built:
        for ending, render in FORMATS.items():
            path = results.tables / f"{table.name}.{ending}"
            write_bytes(path, render(table).encode())
            written.append(path)
    return written


def markdown(table: Table, width: int | None = None) -> str:
    """Return GitHub's Markdown, columns aligned so that it reads well in a terminal, too.

    On a terminal of so many columns long names are shortened, and metrics that don't fit stand in
    blocks below.
    """
    lines = [["method", "clips", *(column.heading for column in table.columns)]]
    for row in table.rows:
        marks = f" [{row.marks}]" if row.marks else ""
        values = [value(table, row, column) for column in table.columns]
        lines.append([row.name + marks, table.clips(row), *values])
    notes = [f"- {note}" for note in table.notes]
    if width is not None:
        notes = [
            line for note in notes for line in textwrap.wrap(note, width, subsequent_indent="  ")
        ]
    return "\n".join([f"## {table.title}", "", *blocks(lines, width), "", *notes, ""])


def blocks(lines: Sequence[Sequence[str]], width: int | None, num_shared: int = 2) -> list[str]:
    """Return one grid, or as many below each other as no wider ones need; all begin with the first,
    shared columns.
    """
    if width is None:
        return grid(lines)
    lines = [[_shortened(name, width // 3), *texts] for name, *texts in lines]
    shared, parts = list(range(num_shared)), [list[int]()]
    for column in range(num_shared, len(lines[0])):
        wider = [*shared, *parts[-1], column]
        if parts[-1] and len(grid([[line[i] for i in wider] for line in lines])[0]) > width:
            parts.append([])
        parts[-1].append(column)
    grids = [grid([[line[i] for i in (*shared, *part)] for line in lines]) for part in parts]
    return [line for number, one in enumerate(grids) for line in [*([""] if number else []), *one]]


def _shortened(name: str, width: int) -> str:
    """Return the name with its middle left out where it is longer."""
    half = (width - 1) // 2
    return name if len(name) <= width else f"{name[:half]}…{name[-half:]}"


def grid(lines: Sequence[Sequence[str]], numbers: bool = True) -> list[str]:
    """Return a Markdown table of a head and rows; with `numbers`, all columns but the first are
    aligned on the right.
    """
    widths = [max(map(len, texts)) for texts in zip(*lines, strict=True)]
    layout = " | ".join(["{:<{}}", *["{:>{}}" if numbers else "{:<{}}"] * (len(widths) - 1)])
    rule = ["-" * widths[0], *("-" * (n - 1) + (":" if numbers else "-") for n in widths[1:])]
    rows = [lines[0], rule, *lines[1:]]
    return [
        f"| {layout.format(*itertools.chain(*zip(row, widths, strict=True)))} |" for row in rows
    ]


def write_page(path: Path, title: str, commands: Sequence[str], origin: str, text: str) -> None:
    """Write a page of the documentation: title, commands, date and origin, text; the old page's
    notes stay.
    """
    before = path.read_text(encoding="utf-8") if path.exists() else ""
    heading = [f"# {title}", "", "```sh", *commands, "```", ""]
    written = f"Written on {datetime.date.today().isoformat()} by {origin}."
    _, found, kept = before.partition(NOTES)
    lines = [*heading, written, "", text.rstrip(), "", *([NOTES + kept] if found else [])]
    write_bytes(path, "\n".join(lines).encode())


def default_command(protocol: Mapping[str, Any]) -> str:
    """Return the command that computes the rows of a matrix, which lies among ours or in the
    current folder.
    """
    name, _, label = protocol["name"].partition(
        "/"
    )  # a matrix of one of several data sets is FILE/LABEL
    root = " --root path/to/data" if "root" in protocol["dataset"] and not label else ""
    return f"geovp run {name if (CONFIGS / f'{name}.toml').exists() else f'{name}.toml'}{root}"


def comma_separated(table: Table) -> str:
    """Return unrounded numbers of each column: mean, interval, standard error, number of clips,
    effective number.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    suffixes = ["", *(f"_{number}" for number in NUMBERS[1:])]
    names = [f"{column.key}{suffix}" for column in table.columns for suffix in suffixes]
    writer.writerow(["method", "privileged_inputs", "clips", "protocol", *names])
    for row in table.rows:
        numbers = [
            number for column in table.columns for number in _numbers(row, column.key).values()
        ]
        texts = ("" if number is None else repr(number) for number in numbers)
        writer.writerow([row.name, row.marks, row.num_clips, row.protocol, *texts])
    return stream.getvalue()


def value(table: Table, row: MethodScores, column: Column) -> str:
    """Return a value as Markdown has it, bold where it is the best."""
    mean, error = table.texts(row, column)
    return (f"**{mean}**" if table.is_best(row, column) else mean) + error


def as_json(tables: Sequence[Table]) -> str:
    """Return unrounded numbers of all columns; null for what is not known."""
    return json.dumps([_plain(table) for table in tables], indent=2, ensure_ascii=False)


def _plain(table: Table) -> dict[str, Any]:
    rows = [
        {
            "method": row.name,
            "privileged_inputs": row.marks,
            "clips": row.num_clips,
            "protocol": row.protocol,
            "values": {column.key: _numbers(row, column.key) for column in table.columns},
            "best": [column.key for column in table.columns if table.is_best(row, column)],
        }
        for row in table.rows
    ]
    columns = {
        one.key: {"heading": one.heading, "higher_is_better": one.higher_is_better}
        for one in table.columns
    }
    return {
        "name": table.name,
        "title": table.title,
        "columns": columns,
        "rows": rows,
        "notes": list(table.notes),
    }


def _numbers(row: MethodScores, key: str) -> dict[str, float | int | None]:
    """Return the numbers of a value by NUMBERS, None for those that are not known."""
    if key not in row.estimates or int(row.estimates[key].count) == 0:
        return {**dict.fromkeys(NUMBERS), "clips": 0}
    one, found = row.estimates[key], row.intervals[key]
    numbers = [
        float(one.mean),
        found.low,
        found.high,
        float(one.error),
        int(one.count),
        found.effective,
    ]
    return {
        name: None if np.isnan(number) else number
        for name, number in zip(NUMBERS, numbers, strict=True)
    }


def columns(lines: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of texts as lines whose columns are aligned on the left."""
    widths = [max(map(len, texts)) for texts in zip(*lines, strict=True)]
    return [
        "  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    ]


FORMATS: dict[str, Callable[[Table], str]] = {"md": markdown, "tex": latex, "csv": comma_separated}
