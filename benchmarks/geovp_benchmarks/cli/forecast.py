"""Evaluate forecasters on pose files.

FOLDER holds NN.txt as in KITTI odometry, and times in NN_times.txt or ../sequences/NN/times.txt.

Examples:
  geovp forecast path/to/poses
  geovp forecast path/to/poses --sequences 03 05 --methods hold motion-prior
"""

import argparse

from geovp_benchmarks.cli.options import Lines, option
from geovp_benchmarks.progress import announce

ARGUMENTS = {
    "": {"poses FOLDER": "Folder of pose files."},
    "windows": {
        "--sequences NN...": option(
            "Sequences. Default: 03 05 06 07 10.", ["03", "05", "06", "07", "10"]
        ),
        "--past N": option("Number of observed poses. Default: 10.", 10),
        "--future N": option("Number of predicted poses. Default: 20.", 20),
        "--stride N": option("Number of frames between the starts of two windows. Default: 5.", 5),
    },
    "output": {
        "--methods SPEC...": (
            "Names or TOML tables of forecasters, see `geovp list forecasters`. Default: all."
        )
    },
}


def run(args: argparse.Namespace) -> Lines:
    """Print a table of forecasters."""
    from geovp_benchmarks.evaluation import forecasting
    from geovp_benchmarks.tables.formats import grid
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
        scores = forecasting.evaluate(windows, forecaster)
        table[name] = forecasting.summary(scores)
    yield f"{len(windows)} windows of {', '.join(args.sequences)}\n"
    names = dict.fromkeys(name for means in table.values() for name in means)
    rows = [
        [name, *(f"{means[name]:.3f}" if name in means else "-" for means in table.values())]
        for name in names
    ]
    yield from grid([["", *table], *rows])
