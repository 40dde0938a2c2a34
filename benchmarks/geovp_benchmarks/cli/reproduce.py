"""Run a published protocol, and print both tables.

Learned methods use the shipped weights; nothing is trained. An interrupted run continues.

Examples:
  geovp reproduce fvs20 --root path/to/kitti_raw --limit 20
  geovp reproduce thesis --root path/to/kitti --samples 10
"""

import argparse
from pathlib import Path

from geovp_benchmarks.cli.options import LinesAndCode, Progress, add, add_group, add_shared


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the protocol, and what of it is computed."""
    add(parser, "name", "NAME", "Protocol, such as fvs20; see `geovp list protocols`.")
    group = add_group(parser, "protocol", "--root", "--limit", "--methods", "--set")
    text = "Largest number of sampled futures. Default: that of the protocol."
    add(group, "--samples", "N", text)
    add_group(parser, "execution", "--workers", "--device")
    group = add_group(parser, "output")
    add(group, "--out", "DIR", "Folder for the results. Default: results/NAME.")
    add_shared(group, "--keep")
    parser.set_defaults(fresh=False)


def run(args: argparse.Namespace, progress: Progress) -> LinesAndCode:
    """Compute what is missing, print both tables, and write them with the figures."""
    from geovp_benchmarks import plots
    from geovp_benchmarks.audit import reproduction
    from geovp_benchmarks.cli.run import compute, exit_code
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.tables import formats, published, tables

    matrix = reproduction.read_matrix(args.name, args.set, args.samples, args.methods)
    matrix = matrix.with_root(args.root).with_device(args.device)
    results = Results(args.out or Path("results") / args.name)
    methods = compute(args, matrix, results, progress)
    paper_tables = published.build(results, args.name)
    formats.write_all(results, [*tables.build(results), *paper_tables])
    yield from map(formats.markdown, paper_tables)
    for _ in plots.write_all(results, plots.Options(), progress):
        pass
    yield f"tables: {results.tables}\nplots:  {results.plots}"
    return exit_code(methods)
