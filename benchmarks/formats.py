"""How tables look: as Markdown, LaTeX and CSV, on paper and on disk."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks import tables
from benchmarks.statistics import Estimate
from benchmarks.store import Results
from benchmarks.tables import Column, Row, Table
from geovp_classic.data.atomic import write_bytes

DASH = "-"
TEX = {
    "&": r"\&",
    "%": r"\%",
    "_": r"\_",
    "#": r"\#",
    "$": r"\$",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
}
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
        values = [_text(table, row, column, "**{}**".format, str) for column in table.columns]
        lines.append([row.name + marks, str(row.num_clips), *values])
    widths = [max(map(len, texts)) for texts in zip(*lines, strict=True)]
    padded = ["| " + " | ".join(_aligned(line, widths)) + " |" for line in lines]
    rule = "| " + " | ".join(["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]) + " |"
    notes = [f"- {note}" for note in table.notes]
    return "\n".join([f"## {table.title}", "", padded[0], rule, *padded[1:], "", *notes, ""])


def latex(table: Table) -> str:
    """A `table` for the booktabs package."""
    head = " & ".join(map(_tex, ["method", "clips", *(column.heading for column in table.columns)]))
    body = []
    for row in table.rows:
        marks = rf"$^{{\mathrm{{{row.marks}}}}}$" if row.marks else ""
        values = [_text(table, row, column, r"\textbf{{{}}}".format, _tex) for column in table.columns]
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


def _text(table: Table, row: Row, column: Column, emphasise: Callable[[str], str], escape: Callable[[str], str]) -> str:
    """Mean ± standard error, emphasised where no row is better; the clips, where fewer than the row has."""
    estimate = row.estimates.get(column.key)
    if estimate is None or int(estimate.count) == 0:
        return "unavailable" if column.unavailable else DASH
    mean = f"{float(estimate.mean):.{column.decimals}f}"
    error = f" ± {float(estimate.error):.{column.decimals}f}" if np.isfinite(estimate.error) else ""
    count = f" (n={int(estimate.count)})" if int(estimate.count) != row.num_clips else ""
    return (emphasise(mean) if table.is_best(row, column) else mean) + escape(error + count)


def _numbers(estimate: Estimate | None) -> tuple[str, str, str]:
    if estimate is None or int(estimate.count) == 0:
        return "", "", "0"
    error = "" if np.isnan(estimate.error) else repr(float(estimate.error))
    return repr(float(estimate.mean)), error, str(int(estimate.count))


def columns(lines: Sequence[Sequence[str]]) -> list[str]:
    """Rows of texts as lines whose columns are aligned on the left."""
    widths = [max(map(len, texts)) for texts in zip(*lines, strict=True)]
    return ["  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip() for line in lines]


def _aligned(texts: Sequence[str], widths: Sequence[int]) -> list[str]:
    return [texts[0].ljust(widths[0]), *(text.rjust(width) for text, width in zip(texts[1:], widths[1:], strict=True))]


def _tex(text: str) -> str:
    return "".join(TEX.get(letter, letter) for letter in text)


FORMATS: dict[str, Callable[[Table], str]] = {"md": markdown, "tex": latex, "csv": comma_separated}
