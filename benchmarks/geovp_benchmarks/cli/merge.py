"""Merge results folders, such as shards of the clips, or make one compact for a repository.

Examples:
  geovp merge results/kitti shards/1 shards/2
  geovp merge results/both laptop/results/kitti desktop/results/kitti
  geovp merge docs/results/stored/fusion results/fusion --compact
"""

import argparse

from geovp_benchmarks.cli.options import LinesAndCode, option
from geovp_classic.errors import BadData

ARGUMENTS = {
    "": {
        "out DIR": "New folder for the results.",
        "folders DIR...": option("Results folders of one matrix.", nargs="+"),
    },
    "output": {"--compact": "Write one score file for all methods, and no predictions."},
    "checks": {"--any-version": "Merge results that other versions of libraries computed."},
}


def run(args: argparse.Namespace) -> LinesAndCode:
    """Merge, and write and print the tables."""
    from geovp_benchmarks.cli.run import conclude
    from geovp_benchmarks.results.merging import merge
    from geovp_benchmarks.results.store import Results

    if args.out.exists() and any(args.out.iterdir()):
        raise BadData(f"{args.out} holds something already: give a new folder first, then others")
    output = Results(args.out)
    folders = [Results(folder) for folder in args.folders]
    merge(output, folders, any_version=args.any_version, is_compact=args.compact)
    if args.compact:
        yield str(output.root)
        return 0
    return (yield from conclude(output))
