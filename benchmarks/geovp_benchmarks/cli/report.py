"""Write report.html of a results folder.

Examples:
  geovp report results/demo
  geovp report results/demo --against copy-last
  geovp report results/demo --by turning
"""

import argparse

from geovp_benchmarks.cli.options import Lines, Progress, add_options, shared


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the results and what is shown of them."""
    add_options(parser, shared("folder"))
    add_options(parser, shared("--methods", "--metrics", "--by", "--against"), "selection")


def run(args: argparse.Namespace, progress: Progress) -> Lines:
    """Write figures and report, and print the path of the report."""
    from geovp_benchmarks import plots, report
    from geovp_benchmarks.results.store import Results

    options = plots.Options(args.metrics, args.by, args.against)
    results = Results(args.folder).select(*args.methods)
    report.write(results, options, progress)
    yield str(results.report)
