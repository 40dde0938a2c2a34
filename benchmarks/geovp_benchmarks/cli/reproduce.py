"""Run a published protocol, and print both tables.

Learned methods use the shipped weights; nothing is trained. An interrupted run continues.

Examples:
  geovp reproduce fvs20 --root path/to/kitti_raw --limit 20
  geovp reproduce thesis --root path/to/kitti --samples 10
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from geovp_benchmarks.cli.options import LinesAndCode, Progress, add_options, shared

if TYPE_CHECKING:
    from geovp_benchmarks.matrix.schema import Matrix


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the protocol, and what of it is computed."""
    add_options(parser, {"name NAME": "Protocol, such as fvs20; see `geovp list protocols`."})
    protocol = {
        **shared("--root", "--limit", "--methods", "--set"),
        "--samples N": "Largest number of sampled futures. Default: that of the protocol.",
    }
    add_options(parser, protocol, "protocol")
    add_options(parser, shared("--workers", "--device"), "execution")
    folder = {"--out DIR": "Folder for the results. Default: results/NAME."}
    add_options(parser, folder | shared("--keep"), "output")


def run(args: argparse.Namespace, progress: Progress) -> LinesAndCode:
    """Compute what is missing, print both tables, and write them with the figures."""
    from geovp_benchmarks import plots
    from geovp_benchmarks.cli.run import exit_code
    from geovp_benchmarks.matrix import CONFIGS, schema
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.running.plan import Options
    from geovp_benchmarks.running.run import run as run_matrix
    from geovp_benchmarks.tables import formats, published, tables
    from geovp_classic import registry

    published.load(args.name)  # an unknown name is bad input
    matrix = schema.read(CONFIGS / f"{args.name}.toml", args.set)
    matrix = with_max_samples(matrix.select(*args.methods), args.samples)
    matrix = matrix.override(root=args.root, device=args.device)
    results = Results(args.out or Path("results") / args.name)
    executor = registry.build("executors", args.workers)
    methods = run_matrix(matrix, results, Options(args.limit, args.keep), executor, progress)
    paper_tables = published.build(results, args.name)
    formats.write_all(results, [*tables.build(results), *paper_tables])
    yield from map(formats.markdown, paper_tables)
    for _ in plots.write_all(results, plots.Options(), progress):
        pass
    yield f"tables: {results.tables}\nplots:  {results.plots}"
    return exit_code(methods)


def with_max_samples(matrix: Matrix, max_samples: int | None) -> Matrix:
    """Return the matrix with at most this many samples of each predictor, if a number is given."""
    if max_samples is None:
        return matrix
    predictors = {
        name: entry.model_copy(
            update={"num_samples": min(max_samples, entry.num_samples or matrix.num_samples)}
        )
        for name, entry in matrix.predictors.items()
    }
    return matrix.model_copy(update={"predictors": predictors})
