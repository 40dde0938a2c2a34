"""Compute the missing results of a matrix.

A run can be interrupted at any moment; the same command continues it. Methods of earlier runs in
the same folder stay when --methods selects others.

Examples:
  geovp run demo
  geovp run fusion --root path/to/kitti --workers 2
  geovp run fusion --root path/to/kitti --out shards/3 --shard 3/64
  geovp run demo --methods "gt-3d + fusion" copy-last
  geovp run demo --set protocol.stride=20 --set renderers.fusion.inpainter.name=telea
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from geovp.progress import announce
from geovp_benchmarks.cli.messages import logger, terminal_width
from geovp_benchmarks.cli.options import LinesAndCode, number, option, shared

if TYPE_CHECKING:
    from geovp_benchmarks.results.store import Results


ARGUMENTS = {
    "": shared("matrix"),
    "matrix": {
        **shared("--root", "--limit", "--methods", "--set"),
        "--samples N": "Largest number of sampled futures. Default: those of the matrix.",
    },
    "execution": {
        **shared("--workers", "--device", "--shard"),
        "--time-limit X": option(
            "Seconds that a clip may take before it counts as failed. Default: 20 times the "
            "median of the clips before, at least 120.",
            dest="limit_s",
            type=number(0.01, kind=float),
        ),
        "--fresh": "Recompute results of other versions of the code.",
        "--dry-run": "Print what would be computed and about how long, only.",
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
    from geovp_benchmarks.running.executors import TimeLimit
    from geovp_benchmarks.running.plan import Plan
    from geovp_benchmarks.running.run import run as run_matrix
    from geovp_classic import registry

    matrix = schema.read(args.matrix, args.set).select(*args.methods)
    matrix = matrix.override(root=args.root, device=args.device, max_samples=args.samples)
    results = Results(folder(args))
    plan = Plan(matrix, results, args.limit, args.keep, args.fresh, args.shard)
    if args.dry_run:
        yield from dry_run(plan, args.workers.get("workers", 1))
        return 0
    executor = registry.build("executors", args.workers)
    run_matrix(plan, executor, limit=TimeLimit(args.limit_s))
    if args.shard is None:
        return (yield from conclude(results, has_report=not args.no_report))
    clips, code = set(plan.own_clips), 0
    for method in results.methods():
        scored, failed = clips & method.scored.keys(), clips & method.scored.failures.keys()
        yield (
            f"{method.label}: {len(scored)} of {len(clips)} clips of the shard, "
            f"{len(failed)} failed"
        )
        code |= bool(failed)
    return code


def folder(args: argparse.Namespace) -> Path:
    """Return the folder for the results."""
    return args.out or Path("results") / args.matrix.stem


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
