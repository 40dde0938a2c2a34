"""Tables as Markdown, LaTeX and CSV."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks import tables
from benchmarks.statistics import Estimate
from benchmarks.store import Results
from benchmarks.tables import Column, Row, Table
from geovp_classic.data.atomic import write_bytes

TEX = {letter: f"\\{letter}" for letter in "&%_#$"} | {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
TEX |= {"±": r"$\pm$", "↑": r"$\uparrow$", "↓": r"$\downarrow$"}


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
        values = [_text(table, row, column, "**{}**") for column in table.columns]
        lines.append([row.name + marks, str(row.num_clips), *values])
    notes = [f"- {note}" for note in table.notes]
    return "\n".join([f"## {table.title}", "", *grid(lines), "", *notes, ""])


def grid(lines: Sequence[Sequence[str]], numbers: bool = True) -> list[str]:
    """A Markdown table of a head and rows; with `numbers`, all columns but the first are aligned on the right."""
    widths = [max(map(len, texts)) for texts in zip(*lines, strict=True)]
    layout = " | ".join(["{:<{}}", *["{:>{}}" if numbers else "{:<{}}"] * (len(widths) - 1)])
    rule = ["-" * widths[0], *("-" * (n - 1) + (":" if numbers else "-") for n in widths[1:])]
    rows = [lines[0], rule, *lines[1:]]
    return [f"| {layout.format(*itertools.chain(*zip(row, widths, strict=True)))} |" for row in rows]


def latex(table: Table) -> str:
    """A `table` for the booktabs package."""
    head = " & ".join(map(_tex, ["method", "clips", *(column.heading for column in table.columns)]))
    body = []
    for row in table.rows:
        marks = rf"$^{{\mathrm{{{row.marks}}}}}$" if row.marks else ""
        values = [_text(table, row, column, r"\textbf{{{}}}") for column in table.columns]
        body.append(" & ".join([_tex(row.name) + marks, str(row.num_clips), *values]) + r" \\")
    lines = [r"\begin{table}", r"\centering", rf"\caption{{{_tex(table.title)}.}}"]
    lines += [rf"\begin{{tabular}}{{lr{'r' * len(table.columns)}}}", r"\toprule", head + r" \\", r"\midrule", *body]
    lines += [r"\bottomrule", r"\end{tabular}", r"\par\footnotesize", *(_tex(note) + r"\\" for note in table.notes)]
    return "\n".join([*lines, r"\end{table}", ""])


def comma_separated(table: Table) -> str:
    """Unrounded numbers: mean, standard error and number of clips of each column."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    names = [f"{column.key}{suffix}" for column in table.columns for suffix in ("", "_standard_error", "_clips")]
    writer.writerow(["method", "grants", "clips", *names])
    for row in table.rows:
        numbers = [_numbers(row.estimates.get(column.key)) for column in table.columns]
        writer.writerow([row.name, row.marks, row.num_clips, *(text for group in numbers for text in group)])
    return stream.getvalue()


def _text(table: Table, row: Row, column: Column, emphasis: str) -> str:
    mean, error = table.texts(row, column)
    error = _tex(error) if "\\" in emphasis else error
    return (emphasis.format(mean) if table.is_best(row, column) else mean) + error


def _numbers(estimate: Estimate | None) -> tuple[str, str, str]:
    if estimate is None or int(estimate.count) == 0:
        return "", "", "0"
    error = "" if np.isnan(estimate.error) else repr(float(estimate.error))
    return repr(float(estimate.mean)), error, str(int(estimate.count))


def columns(lines: Sequence[Sequence[str]]) -> list[str]:
    """Rows of texts as lines whose columns are aligned on the left."""
    widths = [max(map(len, texts)) for texts in zip(*lines, strict=True)]
    return ["  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip() for line in lines]


def _tex(text: str) -> str:
    return text.translate({ord(letter): tex for letter, tex in TEX.items()})


FORMATS: dict[str, Callable[[Table], str]] = {"md": markdown, "tex": latex, "csv": comma_separated}
