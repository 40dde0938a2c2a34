"""Draw the figures of a results folder.

Examples:
  geovp plot results/demo
  geovp plot results/demo --methods copy-last "vo+prior + fusion" --metrics psnr
  geovp plot results/demo --against copy-last
  geovp plot results/demo --by turning
  geovp plot results/demo --format pdf --width 3.3
"""

import argparse

from geovp_benchmarks.cli.options import SELECTION, Lines, number, option, shared

ARGUMENTS = {
    "": shared("folder"),
    "selection": SELECTION,
    "output": {
        "--format pdf|svg|png": "Format. Default: png and svg.",
        "--width INCHES": option(
            "Width in a paper, from 2.5 to 40, without titles. Default: with titles.",
            type=number(2.5, 40, float),
        ),
    },
}


def run(args: argparse.Namespace) -> Lines:
    """Write the figures, and print their paths."""
    from geovp_benchmarks import plots
    from geovp_benchmarks.results.store import Results

    options = plots.Options(args.metrics, args.by, args.against, args.format, args.width)
    results = Results(args.folder).select(*args.methods)
    for _, paths in plots.write_all(results, options):
        yield from map(str, paths)
