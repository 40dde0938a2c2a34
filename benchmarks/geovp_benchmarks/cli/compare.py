"""Compare two results folders or two methods.

Print the settings that differ, and paired differences of all metrics.

Examples:
  geovp compare results/demo results/demo-rescored
  geovp compare results/demo:copy-last 'results/demo:gt-3d + ground-far-plane'
"""

import argparse
from pathlib import Path

from geovp_benchmarks.cli.options import Lines

SIDE = "Results folder, or DIR:METHOD for one method."
ARGUMENTS = {"": {"a A": SIDE, "b B": SIDE}}


def run(args: argparse.Namespace) -> Lines:
    """Print what differs, and paired differences for each method."""
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.tables.comparison import compare

    sides = []
    for text in (args.a, args.b):
        folder, _, method = text.rpartition(":")
        if Path(text).exists() or not folder:
            sides.append(Results(Path(text)))
        else:
            sides.append(Results(Path(folder)).select(method))
    yield f"A: {args.a}\nB: {args.b}"
    yield from compare(*sides)
