"""Run a published protocol from nothing: its table beside the published one, and its figures.

Nothing is trained: learned rows use the weights that come with the package, and say below the table
what these are. The same command goes on where it was interrupted.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from geovp_benchmarks.arguments import add_device, positive
from geovp_benchmarks.progress import progress_bar

if TYPE_CHECKING:
    from geovp_benchmarks.matrix.schema import Matrix
    from geovp_benchmarks.results.store import Method, Results


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which protocol, on which data, and where the results go."""
    parser.add_argument(
        "name",
        metavar="NAME",
        help="a protocol, such as fvs20; `geovp list protocols` describes them",
    )
    parser.add_argument(
        "--root", type=Path, required=True, metavar="FOLDER", help="folder of the data set"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="results folder (default: results/NAME)"
    )
    parser.add_argument(
        "--split",
        metavar="NAME",
        help="in place of the protocol's own; thesis: test (the default, sample data) or "
        "thesis-like-test (07 and 10)",
    )
    parser.add_argument(
        "--methods",
        nargs="+",
        metavar="METHOD",
        help="only these predictors of its matrix (default: all)",
    )
    parser.add_argument(
        "--samples",
        type=positive,
        metavar="N",
        help="at most N samples, where the paper takes more",
    )
    parser.add_argument("--limit", type=positive, metavar="N", help="only the first N clips")
    parser.add_argument(
        "--keep",
        default="3",
        metavar="WHICH",
        help="clips for film strips, as of `geovp run`: N, worst:psnr",
    )
    parser.add_argument(
        "--workers", type=positive, default=1, metavar="N", help="processes (default: this one)"
    )
    add_device(parser)


def run(chosen: argparse.Namespace) -> int:
    """Inpainter what is missing, print both tables and write them with the figures."""
    from geovp_benchmarks import plots
    from geovp_benchmarks.audit import reproduction
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.tables import formats, published, tables

    matrix = reproduction.read_matrix(chosen.name).with_root(chosen.root)
    matrix = reproduction.chosen_rows(matrix, chosen.split, chosen.samples, chosen.methods)
    matrix = matrix.with_device(chosen.device)
    results = Results(chosen.out or Path("results") / chosen.name)
    methods = _fill(matrix, results, chosen)
    paper_tables = published.build(results, chosen.name)
    formats.write_all(results, [*tables.build(results), *paper_tables])
    print(*map(formats.markdown, paper_tables), sep="\n")
    with progress_bar("plots", "figures") as progress:
        drawn = [path.name for _, files in plots.write_all(results, progress) for path in files]
    print(*published.figures(chosen.name, drawn), sep="\n")
    print(f"tables: {results.tables}\nplots:  {results.plots}")
    return int(any(method.status != "done" for method in methods))


def _fill(matrix: Matrix, results: Results, chosen: argparse.Namespace) -> list[Method]:
    """Compute all methods, with the clips that `--keep` asks for."""
    from geovp_benchmarks.cli.run import executor_of, keep_rule
    from geovp_benchmarks.running.plan import Options
    from geovp_benchmarks.running.run import run as fill

    options = Options(chosen.limit, keep_rule(chosen.keep, matrix))
    with progress_bar(chosen.name, "predictions") as progress:
        return fill(matrix, results, options, executor_of(chosen.workers), progress)
