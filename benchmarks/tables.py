"""Tables of means and standard errors with the grants of each row; `formats` turns them into text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from benchmarks import statistics
from benchmarks.matrix import COVERAGE
from benchmarks.statistics import Cube, Estimate
from benchmarks.store import Cell, Results

MARKS = {  # Grant -> (mark beside the row's name, what it means)
    "PAST_POSES": ("p", "true past poses"),
    "FUTURE_POSES": ("f", "true future poses"),
    "PAST_DEPTHS": ("d", "true past depths"),
    "CAMERA_HEIGHT": ("h", "camera height"),
    "WIDE_FRAMES": ("w", "uncropped frames"),
    "RIGHT_FRAMES": ("r", "right camera's frames"),
}
SAMPLE_COUNTS = (2, 5, 10, 20, 50)
BEST_OF = (
    "A best sample is chosen by comparing with the real future, which nobody can do who predicts: such rows don't "
    "compete. 'best of N' chooses anew for every column, as the papers do; 'by' a metric, one sample for all columns."
)


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
    complete: bool  # scored on all clips, by none but its first guesses; only these compete for the best
    estimates: Mapping[str, Estimate]  # by column


@dataclass(frozen=True)
class Table:
    """Columns and rows with the notes that explain them."""

    name: str  # of the files
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...]

    def is_best(self, row: Row, column: Column) -> bool:
        """Whether no complete row is better in the printed digits."""
        sign = 1.0 if column.higher_is_better else -1.0
        rivals = [rounded(other, column) * sign for other in self.rows if other.complete]
        rivals = [value for value in rivals if not np.isnan(value)]
        return row.complete and bool(rivals) and rounded(row, column) * sign == max(rivals)

    def texts(self, row: Row, column: Column) -> tuple[str, str]:
        """The mean, and behind it the standard error and the clips, where fewer than the row has."""
        estimate = row.estimates.get(column.key)
        if estimate is None or int(estimate.count) == 0:
            return "unavailable" if column.unavailable else "-", ""
        error = f" ± {float(estimate.error):.{column.decimals}f}" if np.isfinite(estimate.error) else ""
        count = f" (n={int(estimate.count)})" if int(estimate.count) != row.num_clips else ""
        return f"{float(estimate.mean):.{column.decimals}f}", error + count


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
    return [*tables, *(table for name in main for table in _sampled(name, protocol, cells, rows))]


def title(metric: str) -> str:
    """A metric's name for people: "psnr" is "PSNR", "psnr@covered" is "PSNR, covered pixels"."""
    name, _, pixels = metric.partition("@")
    words = name.upper() if len(name) <= 5 else name.replace("-", " ")
    return f"{words}, {pixels} pixels" if pixels else words


def data_name(protocol: Mapping[str, Any]) -> str:
    """The data set and its split, for people."""
    split = protocol["dataset"].get("split")
    return f"{protocol['dataset_name']}, split {split}" if split else str(protocol["dataset_name"])


def summary(protocol: Mapping[str, Any]) -> str:
    """Which clips, and how many frames of which size are seen and predicted."""
    frames = f"{protocol['num_past']} frames seen, the next {protocol['num_future']} predicted"
    width_px, height_px = protocol["size_px"]
    return f"{len(protocol['clips'])} clips of {data_name(protocol)}; {frames} at {width_px}x{height_px}"


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
    """One row of a cell with one sample, three of a cell with more."""
    keys = _keys([rows])
    cubes = {key: statistics.cube(rows, key) for key in keys}
    higher = {key: bool(protocol["metrics"].get(key.partition("@")[0], {}).get("higher_is_better")) for key in keys}
    num_clips = len(pc.unique(rows["clip"]))
    marks = "".join(MARKS[grant][0] for grant in cell.grants)
    complete = num_clips == len(protocol["clips"])
    return [
        Row(
            cell.label + suffix,
            marks,
            num_clips,
            complete and reduce is statistics.mean_of_samples,
            {key: statistics.overall(reduce(cube, higher[key])) for key, cube in cubes.items()},
        )
        for suffix, reduce in _reductions(cubes, higher, protocol).items()
    ]


def _reductions(
    cubes: Mapping[str, Cube], higher: Mapping[str, bool], protocol: Mapping[str, Any]
) -> dict[str, statistics.Reduction]:
    """The reductions over samples, a row each, by the suffix of the method's name."""
    count = max((cube.values.shape[1] for cube in cubes.values()), default=1)
    if count == 1:
        return {"": statistics.mean_of_samples}
    reductions: dict[str, statistics.Reduction] = {
        f", mean of {count}": statistics.mean_of_samples,
        f", best of {count}": statistics.best_of_samples,
    }
    judges = [name for name in protocol["metrics"] if name in cubes and name != COVERAGE]
    if judges:
        judge = judges[0]
        reductions[f", best of {count} by {title(judge)}"] = statistics.best_by(cubes[judge], higher[judge])
    return reductions


def _sampled(
    name: str, protocol: Mapping[str, Any], cells: Sequence[Cell], rows: Mapping[str, pa.Table]
) -> list[Table]:
    """The expected best of k samples in one metric, where a cell has several samples."""
    about = protocol["metrics"][name]
    higher = bool(about.get("higher_is_better"))
    many = [cell for cell in cells if cell.name in rows and cell.num_samples > 1]
    curves = [statistics.expected_best(statistics.cube(rows[cell.name], name), higher) for cell in many]
    most = max((curve.shape[1] for curve in curves), default=1)
    if most < 2:
        return []
    counts = sorted({1, most, *(count for count in SAMPLE_COUNTS if count < most)})
    lines = []
    for cell, curve in zip(many, curves, strict=True):
        estimates = {f"{name} of {k}": statistics.over_clips(curve[:, k - 1]) for k in counts if k <= curve.shape[1]}
        marks = "".join(MARKS[grant][0] for grant in cell.grants)
        lines.append(Row(cell.label, marks, len(curve), len(curve) == len(protocol["clips"]), estimates))
    columns = tuple(_column(f"{name} of {k}", f"best of {k}", about, lines) for k in counts)
    heading = f"{protocol['name']}: {title(name)} of the best of k samples, on average over all sets of k"
    return [Table(f"samples-{name}", heading, columns, tuple(lines), tuple(_notes(protocol, {name: about}, many)))]


def _notes(protocol: Mapping[str, Any], shown: Mapping[str, Any], cells: Sequence[Cell]) -> list[str]:
    notes = [f"{summary(protocol)}.", statistics.KIND + "; a clip's value is the mean over its steps."]
    if any(cell.num_samples > 1 for cell in cells):
        notes.append(BEST_OF)
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
    outdated = [cell.label for cell in cells if cell.num_outdated]
    if outdated:
        notes.append(f"Computed by another version of the code, in whole or in part: {', '.join(outdated)}.")
    return notes


def _keys(tables: Iterable[pa.Table]) -> list[str]:
    """All columns that have rows, in their order."""
    return list(dict.fromkeys(key for rows in tables for key in pc.unique(rows["metric"]).to_pylist()))


def rounded(row: Row, column: Column) -> float:
    """A mean as it is printed; NaN where there is none."""
    estimate = row.estimates.get(column.key)
    return float("nan") if estimate is None else float(np.round(float(estimate.mean), column.decimals))
