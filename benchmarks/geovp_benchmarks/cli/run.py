"""Compute the missing and stale results of a matrix; can be killed at any moment."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from geovp_benchmarks.arguments import add_device, add_matrix, positive
from geovp_benchmarks.cli.messages import say, width
from geovp_benchmarks.progress import announce, progress_bar

if TYPE_CHECKING:
    from geovp_benchmarks.matrix.schema import Matrix
    from geovp_benchmarks.results.store import Method, Results
    from geovp_benchmarks.running.executors import Executor
    from geovp_benchmarks.running.selection import Ranking, Selection

KEEP = """keep the predictions of N clips (4), of all, of clips named with commas between, or of
three clips selected by a score: worst:METRIC, best:METRIC or median:METRIC of the first complete
method, pose sources with renderers first, or worst:METRIC:METHOD. Selected clips are known after
the run: all methods are computed on them once more"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What to run, where, and how much of it."""
    add_matrix(parser, "a matrix file, or the name of a built-in one such as demo")
    parser.add_argument(
        "--root", type=Path, metavar="FOLDER", help="folder of the data set, in place of the file's"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="results folder (default: results/<name of the file>)",
    )
    parser.add_argument("--limit", type=positive, metavar="N", help="only the first N clips")
    add_device(parser)
    parser.add_argument("--keep", default="4", metavar="WHICH", help=KEEP)
    parser.add_argument(
        "--fresh",
        action="store_true",
        help="recompute results of another version of the code",
    )
    set_help = (
        "a setting of the file, such as protocol.stride=20 or "
        "renderers.fusion.inpainter.name=telea; again for more"
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=set_help)
    dry_help = "say what is to do, how long and how large it would be, and write nothing"
    parser.add_argument("--dry-run", action="store_true", help=dry_help)
    parser.add_argument("--no-report", action="store_true", help="no plots and no report")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=positive,
        metavar="N",
        help="processes on this machine (default: this one)",
    )
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="a Dask cluster that sees the same folders"
    )


def run(chosen: argparse.Namespace) -> int:
    """Compute, then write all views of the results; of several data sets one after the other."""
    with progress_bar(chosen.matrix.stem, "predictions"):
        announce("starting")
        from geovp_benchmarks.results.store import Results
        from geovp_benchmarks.running import multiple_datasets
        from geovp_classic.data.atomic import write_bytes

        matrices = multiple_datasets.read(chosen.matrix, chosen.root, chosen.set)
    whole = Results(chosen.out or Path("results") / chosen.matrix.stem)
    if not chosen.dry_run:
        whole.write_datasets([*matrices])
    codes = [
        _fill(chosen, matrix, Results(whole.root / label)) for label, matrix in matrices.items()
    ]
    if len(codes) > 1 and not chosen.dry_run:
        text = multiple_datasets.side_by_side(whole)
        write_bytes(whole.tables / "datasets.md", text.encode())
        print(multiple_datasets.side_by_side(whole, width()))
    return max(codes)


def _fill(chosen: argparse.Namespace, matrix: Matrix, results: Results) -> int:
    """Compute the methods of one data set; the exit code."""
    matrix = matrix.with_device(chosen.device)
    with progress_bar(matrix.name, "predictions") as progress:
        announce("starting")
        from geovp_benchmarks.running.plan import Options
        from geovp_benchmarks.running.run import run as fill

        options = Options(chosen.limit, keep_rule(chosen.keep, matrix), chosen.fresh)
        if chosen.dry_run:
            from geovp_benchmarks.running.dry_run import dry_run

            print(*dry_run(matrix, results, options, chosen.workers or 1, progress), sep="\n")
            return 0
        executor, before = executor_of(chosen.workers, chosen.scheduler), results.set_aside()
        methods = fill(matrix, results, options, executor, progress)
    if results.set_aside() - before:
        kept = results.root / "earlier"
        say.warning(
            f"the protocol or settings changed: earlier methods are kept in {kept} and come back "
            "with the old ones"
        )
    return conclude(results, methods, with_report=not chosen.no_report)


def conclude(
    results: Results, methods: Sequence[Method], with_report: bool, as_json: bool = False
) -> int:
    """Write all views, print the table, and say how the methods ended."""
    from geovp_benchmarks import report
    from geovp_benchmarks.tables import formats, tables

    built = tables.build(results)
    formats.write_all(results, built)
    paths = [f"tables: {results.tables}"]
    if with_report and any(method.num_clips for method in methods):
        with progress_bar("plots", "figures") as progress:
            report.write(results, progress)
        paths += [f"plots:  {results.plots}", f"report: {results.report}"]
    if as_json:
        print(formats.as_json(built[:1]))
    else:
        print(formats.markdown(built[0], width()), *paths, sep="\n")
    return _judge(methods)


def _judge(methods: Sequence[Method]) -> int:
    """Say how the methods ended, and return the exit code."""
    count = len(methods)
    outdated = sum(method.num_outdated > 0 for method in methods)
    if outdated:
        say.warning(
            f"{outdated} of {count} methods hold scores of another version of the code (named "
            "below the table): `geovp run --fresh` recomputes them"
        )
    left = sum(method.status != "done" for method in methods)
    if left:
        say.error(f"{left} of {count} methods are not done: see below the table")
    partly = sum(method.num_failed > 0 for method in methods if method.status == "done")
    if partly:
        say.error(
            f"{partly} of {count} methods could not predict some clips, which are scored as "
            "copies of the last frame: see below the table"
        )
    return int(left + partly > 0)


def executor_of(workers: int | None, scheduler: str | None = None) -> Executor:
    """What runs the tasks: this process, several of this machine, or a Dask cluster."""
    from geovp_classic import registry

    spec: dict[str, object] = {"name": "serial"}
    if workers is not None and workers > 1:
        spec = {"name": "processes", "workers": workers}
    if scheduler is not None:
        spec = {"name": "dask", "address": scheduler}
    executor: Executor = registry.build("executors", spec)
    return executor


def keep_rule(text: str, matrix: Matrix) -> int | Selection | Ranking | None:
    """What --keep asks for: a number, clips, a rule, or None for all."""
    from geovp_benchmarks.running.selection import Ranking, Selection

    if text == "all":
        return None
    if text.removeprefix("-").isdecimal():
        return max(0, int(text))
    if ":" in text:
        return Ranking.parse(text, matrix)
    return Selection(tuple(text.split(",")))
