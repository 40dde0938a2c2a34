"""Write report.html of a results folder.

Examples:
  geovp report results/demo
  geovp report results/demo --against copy-last
  geovp report results/demo --by turning
"""

import argparse

from geovp_benchmarks.cli.options import SELECTION, Lines, shared

ARGUMENTS = {"": shared("folder"), "selection": SELECTION}


def run(args: argparse.Namespace) -> Lines:
    """Write figures and report, and print the path of the report."""
    from geovp_benchmarks import plots, report
    from geovp_benchmarks.results.store import Results

    options = plots.Options(args.metrics, args.by, args.against)
    results = Results(args.folder).select(*args.methods)
    report.write(results, options)
    yield str(results.report)
