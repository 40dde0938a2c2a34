"""Compute the missing results of a matrix.

A run can be interrupted at any moment; the same command continues it. --keep worst:METRIC (also
median and best) keeps three clips by the scores of the first complete method, and
worst:METRIC:METHOD by those of METHOD; all methods predict these clips once more.

Examples:
  geovp run demo
  geovp run fusion --root path/to/kitti --workers 2
  geovp run demo --set protocol.stride=20 --set renderers.fusion.inpainter.name=telea
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from geovp_benchmarks.cli.messages import logger, terminal_width
from geovp_benchmarks.cli.options import add, add_flag, add_group, add_shared
from geovp_benchmarks.progress import announce, progress_bar

if TYPE_CHECKING:
    from geovp_benchmarks.matrix.schema import Matrix
    from geovp_benchmarks.results.store import Method, Results
    from geovp_benchmarks.running.plan import Options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the matrix, its changes, and how it is computed."""
    add_shared(parser, "matrix")
    add_group(parser, "matrix", "--root", "--limit", "--set")
    group = add_group(parser, "execution", "--workers", "--device")
    add_flag(group, "--fresh", "Recompute results of other versions of the code.")
    add_flag(group, "--dry-run", "Print what would be computed, with time and size, only.")
    group = add_group(parser, "output", "--keep")
    add(group, "--out", "DIR", "Folder for the results. Default: results/MATRIX.")
    add_flag(group, "--no-report", "Write no plots and no report.")


def run(args: argparse.Namespace) -> int:
    """Compute all data sets in turn, and write and print their tables."""
    with progress_bar(args.matrix.stem, "predictions"):
        announce("starting")
        from geovp_benchmarks.results.store import Results
        from geovp_benchmarks.running import multiple_datasets
        from geovp_benchmarks.running.dry_run import dry_run
        from geovp_classic.data.atomic import write_bytes

        matrices = multiple_datasets.read(args.matrix, args.root, args.set)
    root = args.out or Path("results") / args.matrix.stem
    if args.dry_run:
        for label, matrix in matrices.items():
            workers = args.workers.get("workers", 1)
            with progress_bar(matrix.name, "predictions") as progress:
                options = options_of(args)
                plan = dry_run(matrix, Results(root / label), options, workers, progress)
            print(*plan, sep="\n")
        return 0
    results = Results(root)
    results.write_datasets([*matrices])
    codes = []
    for label, matrix in matrices.items():
        dataset = Results(root / label)
        methods = compute(args, matrix.with_device(args.device), dataset)
        codes.append(conclude(dataset, methods, not args.no_report))
    if len(codes) > 1:
        table = multiple_datasets.side_by_side(results)
        write_bytes(results.tables / "datasets.md", table.encode())
        print(multiple_datasets.side_by_side(results, terminal_width()))
    return max(codes)


def compute(args: argparse.Namespace, matrix: Matrix, results: Results) -> list[Method]:
    """Compute the missing results of a data set, and return its methods."""
    from geovp_benchmarks.running import run
    from geovp_classic import registry

    archived = results.set_aside()
    executor = registry.build("executors", args.workers)
    with progress_bar(matrix.name, "predictions") as progress:
        methods = run.run(matrix, results, options_of(args), executor, progress)
    if results.set_aside() - archived:
        logger.warning(
            f"settings changed: earlier results are in {results.root / 'earlier'}, and a run with "
            "the earlier settings restores them"
        )
    return methods


def options_of(args: argparse.Namespace) -> Options:
    """Return the options of a run."""
    from geovp_benchmarks.running.plan import Options

    return Options(args.limit, args.keep, args.fresh)


def conclude(results: Results, methods: Sequence[Method], with_report: bool) -> int:
    """Write tables and report, print the main table, and return the exit code."""
    from geovp_benchmarks import report
    from geovp_benchmarks.tables import formats, tables

    built = tables.build(results)
    formats.write_all(results, built)
    with_report = with_report and any(method.num_clips for method in methods)
    if with_report:
        with progress_bar("plots", "figures") as progress:
            report.write(results, progress)
    print(formats.markdown(built[0], terminal_width()))
    print(f"tables: {results.tables}")
    if with_report:
        print(f"plots:  {results.plots}\nreport: {results.report}")
    return exit_code(methods)


def exit_code(methods: Sequence[Method]) -> int:
    """Log how many methods are incomplete, and return 1 if any are."""
    count = len(methods)
    if outdated := sum(method.num_outdated > 0 for method in methods):
        logger.warning(
            f"{outdated} of {count} methods have scores of another version of the code, see below "
            "the table: `geovp run --fresh` recomputes them"
        )
    undone = sum(method.status != "done" for method in methods)
    if undone:
        logger.error(f"{undone} of {count} methods are not done: see below the table")
    partial = sum(method.num_failed > 0 for method in methods if method.status == "done")
    if partial:
        logger.error(f"{partial} of {count} methods failed on some clips: see below the table")
    return int(undone + partial > 0)
