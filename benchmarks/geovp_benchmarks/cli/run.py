"""Compute the missing results of a matrix.

A run can be interrupted at any moment; the same command continues it. Methods of earlier runs in
the same folder stay when --methods selects others.

Examples:
  geovp run demo
  geovp run fusion --root path/to/kitti --workers 2
  geovp run demo --methods "gt-3d + fusion" copy-last
  geovp run demo --set protocol.stride=20 --set renderers.fusion.inpainter.name=telea
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from geovp_benchmarks.cli.messages import logger, terminal_width
from geovp_benchmarks.cli.options import LinesAndCode, shared
from geovp_benchmarks.progress import announce

if TYPE_CHECKING:
    from geovp_benchmarks.matrix.schema import Matrix
    from geovp_benchmarks.results.store import Method, Results


ARGUMENTS = {
    "": shared("matrix"),
    "matrix": {
        **shared("--root", "--limit", "--methods", "--set"),
        "--samples N": "Largest number of sampled futures. Default: those of the matrix.",
    },
    "execution": {
        **shared("--workers", "--device"),
        "--fresh": "Recompute results of other versions of the code.",
        "--dry-run": "Print what would be computed, with time and size, only.",
    },
    "output": {
        **shared("--keep"),
        "--out DIR": "Folder for the results. Default: results/MATRIX.",
        "--no-report": "Write no plots and no report.",
    },
}


def run(args: argparse.Namespace) -> LinesAndCode:
    """Compute what is missing, and write and print the tables."""
    announce("starting")
    from geovp_benchmarks.matrix import schema
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.running.dry_run import dry_run
    from geovp_benchmarks.running.plan import Plan
    from geovp_benchmarks.running.run import run as run_matrix
    from geovp_classic import registry

    matrix = with_max_samples(schema.read(args.matrix, args.set), args.samples)
    matrix = matrix.select(*args.methods).override(root=args.root, device=args.device)
    results = Results(folder(args))
    plan = Plan(matrix, results, args.limit, args.keep, args.fresh)
    if args.dry_run:
        yield from dry_run(plan, args.workers.get("workers", 1))
        return 0
    executor = registry.build("executors", args.workers)
    run_matrix(plan, executor)
    return (yield from conclude(results, has_report=not args.no_report))


def folder(args: argparse.Namespace) -> Path:
    """Return the folder for the results."""
    return args.out or Path("results") / args.matrix.stem


def with_max_samples(matrix: Matrix, max_samples: int | None) -> Matrix:
    """Return the matrix with at most this many samples of each method, if a number is given."""
    if max_samples is None:
        return matrix
    entries = {
        role: {
            name: entry.model_copy(
                update={"num_samples": min(max_samples, entry.num_samples or matrix.num_samples)}
            )
            for name, entry in getattr(matrix, role).items()
        }
        for role in ("pose_sources", "predictors")
    }
    return matrix.model_copy(update=entries)


def conclude(results: Results, *, has_report: bool = False) -> LinesAndCode:
    """Write tables, and a report if asked; yield the main table and return the code."""
    from geovp_benchmarks.tables import formats, tables

    built, methods = tables.build(results), results.methods()
    formats.write_all(results, built)
    lines = [formats.markdown(built[0], terminal_width()), f"tables: {results.tables}"]
    if has_report and any(method.num_clips for method in methods):
        from geovp_benchmarks import plots, report  # Matplotlib takes long to import

        report.write(results, plots.Options())  # also if nobody reads the lines
        lines += [f"plots:  {results.plots}", f"report: {results.report}"]
    yield from lines
    return exit_code(methods)


def exit_code(methods: Sequence[Method]) -> int:
    """Log how many methods are incomplete, and return 1 if any are."""
    if outdated := sum(method.num_outdated > 0 for method in methods):
        logger.warning(
            f"{outdated} of {len(methods)} methods have scores of another version of the code: "
            "`geovp run --fresh` recomputes them"
        )
    if incomplete := sum(
        method.status != "done" or bool(method.scored.failures) for method in methods
    ):
        logger.error(
            f"{incomplete} of {len(methods)} methods are not done, or failed on some clips: see "
            "below the table"
        )
    return int(incomplete > 0)
