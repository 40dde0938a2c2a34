"""Tables of stored rows, as Markdown, LaTeX and CSV: means, how sure they are, and what each row was granted."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from benchmarks import statistics
from benchmarks.matrix import COVERAGE
from benchmarks.statistics import Estimate
from benchmarks.store import Cell, Results, write_bytes

MARKS = {  # Grant -> (mark beside the row's name, what it means)
    "PAST_POSES": ("p", "true past poses"),
    "FUTURE_POSES": ("f", "true future poses"),
    "PAST_DEPTHS": ("d", "true past depths"),
    "CAMERA_HEIGHT": ("h", "camera height"),
    "WIDE_FRAMES": ("w", "uncropped frames"),
    "RIGHT_FRAMES": ("r", "right camera's frames"),
}
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


@dataclass(frozen=True)
class Column:
    """One metric over one set of pixels."""

    key: str  # "psnr", "psnr@covered"
    heading: str
    higher_is_better: bool
    decimals: int
    unavailable: bool = False


@dataclass(frozen=True)
class Row:
    """One method."""

    name: str
    marks: str
    num_clips: int
    complete: bool  # scored on all clips; only these compete for the best
    estimates: Mapping[str, Estimate]  # by column


@dataclass(frozen=True)
class Table:
    """Numbers with everything that a reader has to know beside them."""

    name: str  # of the files
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...]

    def is_best(self, row: Row, column: Column) -> bool:
        """Whether no complete row is better, as far as the printed digits tell."""
        sign = 1.0 if column.higher_is_better else -1.0
        rivals = [_rounded(other, column) * sign for other in self.rows if other.complete]
        rivals = [value for value in rivals if not np.isnan(value)]
        return row.complete and bool(rivals) and _rounded(row, column) * sign == max(rivals)


def build(results: Results) -> list[Table]:
    """The main table (whole frames and poses), then one per frame metric that was also taken over sets of pixels."""
    protocol, cells = results.protocol(), results.cells()
    rows = {cell.name: results.scores(cell.name) for cell in cells if cell.status in ("done", "partial")}
    keys = _keys(rows.values())
    metrics: Mapping[str, Mapping[str, Any]] = protocol["metrics"]
    main = [name for name in metrics if name != COVERAGE]
    methods = [line for cell in cells if cell.name in rows for line in _lines(cell, rows[cell.name], protocol)]
    tables = [_table("scores", "whole frames and poses", {key: title(key) for key in main}, protocol, methods, cells)]
    for name in (name for name in main if metrics[name]["role"] == "frame"):
        apart = [key for key in keys if key.startswith(f"{name}@")]
        if apart:
            columns = {name: "all pixels", **{key: f"{key.partition('@')[2]} pixels" for key in apart}}
            columns |= {COVERAGE: title(COVERAGE)} if COVERAGE in keys else {}
            heading = f"{title(name)} over sets of pixels"
            tables.append(_table(f"pixels-{name}", heading, columns, protocol, methods, cells))
    return tables


def write_all(results: Results) -> list[Path]:
    """Write all tables in all formats and return the files."""
    written = []
    formats: dict[str, Callable[[Table], str]] = {"md": markdown, "tex": latex, "csv": comma_separated}
    for table in build(results):
        for ending, render in formats.items():
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


def title(metric: str) -> str:
    """A metric's name for people: "psnr" is "PSNR", "psnr@covered" is "PSNR, covered pixels"."""
    name, _, pixels = metric.partition("@")
    words = name.upper() if len(name) <= 5 else name.replace("-", " ")
    return f"{words}, {pixels} pixels" if pixels else words


def _table(
    name: str,
    heading: str,
    columns: Mapping[str, str],  # key -> words
    protocol: Mapping[str, Any],
    rows: Sequence[Row],
    cells: Sequence[Cell],
) -> Table:
    abouts = {key: protocol["metrics"][key.partition("@")[0]] for key in columns}
    made = tuple(_column(key, words, abouts[key], rows) for key, words in columns.items())
    shown = {key.partition("@")[0]: about for key, about in abouts.items()}
    return Table(name, f"{protocol['name']}: {heading}", made, tuple(rows), tuple(_notes(protocol, shown, cells)))


def _column(key: str, words: str, about: Mapping[str, Any], rows: Sequence[Row]) -> Column:
    means = np.array([float(row.estimates[key].mean) for row in rows if key in row.estimates])
    known = means[np.isfinite(means)]
    higher = bool(about.get("higher_is_better", False))
    unit = f" ({about['unit']})" if about.get("unit") else ""
    arrow = ("↑" if higher else "↓") if "higher_is_better" in about else ""
    decimals = 2 if np.abs(known).max(initial=0.0) >= 10 else 3
    unavailable = bool(about["unavailable"]) and not len(known)
    return Column(key, f"{words}{unit} {arrow}".strip(), higher, decimals, unavailable)


def _lines(cell: Cell, rows: pa.Table, protocol: Mapping[str, Any]) -> list[Row]:
    """One row of a cell with one sample, two of a cell with more."""
    keys = _keys([rows])
    cubes = {key: statistics.cube(rows, key) for key in keys}
    higher = {key: bool(protocol["metrics"].get(key.partition("@")[0], {}).get("higher_is_better")) for key in keys}
    num_clips, num_samples = len(pc.unique(rows["clip"])), max((c.values.shape[1] for c in cubes.values()), default=1)
    reductions: dict[str, statistics.Reduction] = {"": statistics.mean_of_samples}
    if num_samples > 1:
        reductions = {f", mean of {num_samples}": statistics.mean_of_samples}
        reductions[f", best of {num_samples}"] = statistics.best_of_samples
    marks = "".join(MARKS[grant][0] for grant in cell.grants)
    complete = num_clips == len(protocol["clips"])
    return [
        Row(
            cell.label + suffix,
            marks,
            num_clips,
            complete,
            {key: statistics.overall(reduce(cube, higher[key])) for key, cube in cubes.items()},
        )
        for suffix, reduce in reductions.items()
    ]


def _notes(protocol: Mapping[str, Any], shown: Mapping[str, Any], cells: Sequence[Cell]) -> list[str]:
    width_px, height_px = protocol["size_px"]
    split = f", split {protocol['dataset']['split']}" if "split" in protocol["dataset"] else ""
    clips = f"{len(protocol['clips'])} clips of {protocol['dataset_name']}{split}"
    frames = (
        f"{protocol['num_past']} frames seen, the next {protocol['num_future']} predicted at {width_px}x{height_px}"
    )
    notes = [f"{clips}; {frames}.", statistics.KIND + "; a clip's value is the mean over its steps."]
    used = {grant for cell in cells for grant in cell.grants}
    legend = [f"[{mark}] {meaning}" for grant, (mark, meaning) in MARKS.items() if grant in used]
    if legend:
        notes.append(f"Granted beyond the observed frames: {', '.join(legend)}.")
    for name, about in shown.items():
        if about["unavailable"]:
            notes.append(f"{title(name)}: unavailable: {about['unavailable']}.")
        elif about.get("definition"):
            notes.append(f"{title(name)}: {about['definition']}.")
    for cell in cells:
        if cell.status == "partial":
            notes.append(f"{cell.label}: partial: {cell.num_clips} of {len(protocol['clips'])} clips; run again.")
        elif cell.status != "done":
            notes.append(f"{cell.label}: {cell.status}: {cell.reason}.")
    return notes


def _keys(tables: Any) -> list[str]:
    """All columns that have rows, in their order."""
    return list(dict.fromkeys(key for rows in tables for key in pc.unique(rows["metric"]).to_pylist()))


def _rounded(row: Row, column: Column) -> float:
    estimate = row.estimates.get(column.key)
    return float("nan") if estimate is None else float(np.round(float(estimate.mean), column.decimals))


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


def _aligned(texts: Sequence[str], widths: Sequence[int]) -> list[str]:
    return [texts[0].ljust(widths[0]), *(text.rjust(width) for text, width in zip(texts[1:], widths[1:], strict=True))]


def _tex(text: str) -> str:
    return "".join(TEX.get(letter, letter) for letter in text)
