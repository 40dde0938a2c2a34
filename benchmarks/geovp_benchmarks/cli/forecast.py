"""Evaluate forecasters on pose files.

FOLDER holds NN.txt as in KITTI odometry, and times in NN_times.txt or ../sequences/NN/times.txt.

Examples:
  geovp forecast path/to/poses
  geovp forecast path/to/poses --sequences 03 05 --methods hold motion-prior
"""

import argparse

from geovp.progress import announce
from geovp_benchmarks.cli.options import Lines

ARGUMENTS = {
    "": {"poses FOLDER": "Folder of pose files."},
    "windows": {
        "--sequences NN...": "Sequences. Default: all in the folder.",
        "--past N = 10": "Number of observed poses.",
        "--future N = 20": "Number of predicted poses.",
        "--stride N = 5": "Number of frames between the starts of two windows.",
    },
    "output": {
        "--methods SPEC...": (
            "Names or TOML tables of forecasters, see `geovp list forecasters`. Default: all."
        )
    },
}


def run(args: argparse.Namespace) -> Lines:
    """Print a table of forecasters."""
    from geovp_benchmarks.tables.formats import grid
    from geovp_benchmarks.trajectories import forecasting
    from geovp_classic import registry

    forecasters = {
        str(spec): registry.build("forecasters", spec, "--methods")
        for spec in args.methods or registry.names("forecasters")
    }
    windows = forecasting.read_windows(
        args.poses, args.sequences, args.past, args.future, args.stride
    )
    table = {}
    for name, forecaster in forecasters.items():
        announce(name)
        table[name] = forecasting.evaluate(windows, forecaster)
    yield f"{len(windows)} windows of {', '.join(args.sequences) or 'all sequences'}\n"
    names = dict.fromkeys(name for means in table.values() for name in means)
    rows = [
        [name, *(f"{means[name]:.3f}" if name in means else "-" for means in table.values())]
        for name in names
    ]
    yield from grid([["", *table], *rows])
