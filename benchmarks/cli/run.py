"""Compute the missing and stale results of a matrix; can be killed at any moment."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from geovp_benchmarks.arguments import positive
from geovp_benchmarks.progress import progress_bar
from geovp_classic.errors import BadData

if TYPE_CHECKING:
    from geovp_benchmarks.executors import Executor
    from geovp_benchmarks.matrix import Matrix
    from geovp_benchmarks.selection import Ranking, Selection
    from geovp_benchmarks.store import Cell, Results

KEEP = """keep the predictions of N clips (3), of all, of clips named with commas between, or of three clips chosen by a
score: worst:METRIC, best:METRIC or median:METRIC of the first complete row, pose sources with renderers first, or
worst:METRIC:ROW. Chosen clips are known after the run: all rows are computed on them once more"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What to run, where, and how much of it."""
    parser.add_argument("matrix", type=Path, metavar="MATRIX.toml")
    parser.add_argument("--root", type=Path, metavar="FOLDER", help="folder of the data set, in place of the file's")
    parser.add_argument("--out", type=Path, metavar="DIR", help="results folder (default: results/<name of the file>)")
    parser.add_argument("--limit", type=positive, metavar="N", help="only the first N clips")
    parser.add_argument("--keep", default="3", metavar="WHICH", help=KEEP)
    parser.add_argument("--fresh", action="store_true", help="compute anew what another version of the code computed")
    parser.add_argument("--no-report", action="store_true", help="no plots and no report")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=positive, metavar="N", help="processes on this machine (default: this one)")
    where.add_argument("--scheduler", metavar="ADDRESS", help="a Dask cluster that sees the same folders")


def run(chosen: argparse.Namespace) -> int:
    """Compute, then write all views of the results; of several data sets one after the other."""
    from geovp_benchmarks import multiple_datasets
    from geovp_benchmarks.store import Results
    from geovp_classic.data.atomic import write_bytes

    matrices = multiple_datasets.read(chosen.matrix, chosen.root)
    whole = Results(chosen.out or Path("results") / chosen.matrix.stem)
    whole.write_datasets([*matrices])
    codes = [_fill(chosen, matrix, Results(whole.root / label)) for label, matrix in matrices.items()]
    if len(codes) > 1:
        text = multiple_datasets.side_by_side(whole)
        write_bytes(whole.tables / "datasets.md", text.encode())
        print(text)
    return max(codes)


def _fill(chosen: argparse.Namespace, matrix: Matrix, results: Results) -> int:
    """Compute the cells of one data set; the exit code."""
    from geovp_benchmarks.planning import Options
    from geovp_benchmarks.run import run as fill
    from geovp_benchmarks.selection import Ranking

    keep = keep_rule(chosen.keep, matrix)
    options = Options(chosen.limit, 0 if isinstance(keep, Ranking) else keep, chosen.fresh)
    executor, before = _executor(chosen), results.set_aside()
    with progress_bar(matrix.name, "predictions") as progress:
        cells = fill(matrix, results, options, executor, progress)
    if results.set_aside() - before:
        print(
            "geovp: the protocol or settings changed: earlier rows are kept in "
            f"{results.root / 'earlier'} and come back with the old ones",
            file=sys.stderr,
        )
    if isinstance(keep, Ranking):
        try:
            options = dataclasses.replace(options, keep=keep.choose(results))
        except BadData:
            conclude(results, cells, with_report=not chosen.no_report)
            raise
        with progress_bar("chosen clips", "predictions") as progress:
            cells = fill(matrix, results, options, executor, progress)
    return conclude(results, cells, with_report=not chosen.no_report)


def conclude(results: Results, cells: Sequence[Cell], with_report: bool) -> int:
    """Print the table, write all views, and say how the cells ended."""
    from geovp_benchmarks import formats, report, tables

    print(formats.markdown(tables.build(results)[0]))
    formats.write_all(results)
    print(f"tables: {results.tables}")
    if with_report and any(cell.num_clips for cell in cells):
        with progress_bar("plots", "figures") as progress:
            report.write(results, progress)
        print(f"plots:  {results.plots}")
        print(f"report: {results.report}")
    outdated = sum(cell.num_outdated > 0 for cell in cells)
    if outdated:
        print(
            f"geovp: {outdated} of {len(cells)} cells hold rows that another version of the code computed (named "
            "below the table): `geovp run --fresh` computes them anew",
            file=sys.stderr,
        )
    left = sum(cell.status != "done" for cell in cells)
    if left:
        print(f"geovp: {left} of {len(cells)} cells are not done: see below the table", file=sys.stderr)
    partly = sum(cell.num_failed > 0 for cell in cells if cell.status == "done")
    if partly:
        print(
            f"geovp: {partly} of {len(cells)} cells could not predict some clips, which are scored as copies of the "
            "last frame: see below the table",
            file=sys.stderr,
        )
    return int(left + partly > 0)


def _executor(chosen: argparse.Namespace) -> Executor:
    """What runs the tasks."""
    from geovp_classic import registry

    spec: dict[str, object] = {"name": "serial"}
    if chosen.workers is not None and chosen.workers > 1:
        spec = {"name": "processes", "workers": chosen.workers}
    if chosen.scheduler is not None:
        spec = {"name": "dask", "address": chosen.scheduler}
    executor: Executor = registry.build("executors", spec)
    return executor


def keep_rule(text: str, matrix: Matrix) -> int | Selection | Ranking | None:
    """What --keep asks for: a number, clips, a rule, or None for all."""
    from geovp_benchmarks.selection import NAMED, WHICH, Ranking, Selection

    if text == "all":
        return None
    if text.removeprefix("-").isdecimal():
        return max(0, int(text))
    if ":" in text or text in WHICH:
        return Ranking.parse(text, matrix)
    return Selection(tuple(text.split(",")), NAMED)
