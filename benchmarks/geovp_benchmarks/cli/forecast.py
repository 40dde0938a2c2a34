"""Evaluate forecasters on pose files.

FOLDER holds NN.txt as in KITTI odometry, and times in NN_times.txt or ../sequences/NN/times.txt.

Examples:
  geovp forecast evaluate path/to/poses
  geovp forecast evaluate path/to/poses --sequences 03 05 --methods hold motion-prior
"""

import argparse
import json
from pathlib import Path

from geovp_benchmarks.cli.options import add, add_flag, add_group
from geovp_benchmarks.progress import announce, progress_bar
from geovp_classic.errors import BadData


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the windows and the forecasters."""
    add(parser, "action", "evaluate", "Print errors and calibration.", choices=["evaluate"])
    add(parser, "poses", "FOLDER", "Folder of pose files.")
    group = add_group(parser, "windows")
    text = "Sequences. Default: those of 03 05 06 07 10 that are there, or else all."
    add(group, "--sequences", "NN...", text)
    add(group, "--past", "N", "Number of observed poses. Default: 10.", 10)
    add(group, "--future", "N", "Number of predicted poses. Default: 20.", 20)
    text = "Number of frames between the starts of two windows. Default: 5."
    add(group, "--stride", "N", text, 5)
    group = add_group(parser, "output")
    text = "Names or TOML tables of forecasters, see `geovp list forecasters`. Default: all."
    add(group, "--methods", "SPEC...", text)
    add_flag(group, "--json", "Print JSON. Default: text.")


def run(args: argparse.Namespace) -> int:
    """Print a table of forecasters."""
    from geovp_benchmarks.evaluation import forecasting
    from geovp_benchmarks.tables.formats import grid
    from geovp_classic import registry

    forecasters = {
        str(spec): registry.build("forecasters", spec, "--methods")
        for spec in args.methods or registry.names("forecasters")
    }
    sequences = args.sequences or test_sequences(args.poses)
    windows = forecasting.read_windows(args.poses, sequences, args.past, args.future, args.stride)
    table = {}
    with progress_bar("forecast", "windows") as progress:
        for name, forecaster in forecasters.items():
            announce(name)
            scores = forecasting.evaluate(windows, forecaster, progress)
            table[name] = forecasting.summary(scores)
    if args.json:
        content = {"sequences": sequences, "windows": len(windows), "forecasters": table}
        print(json.dumps(content, indent=2))
    else:
        print(f"{len(windows)} windows of {', '.join(sequences)}", "", sep="\n")
        names = dict.fromkeys(name for means in table.values() for name in means)
        rows = [
            [name, *(f"{means[name]:.3f}" if name in means else "-" for means in table.values())]
            for name in names
        ]
        print(*grid([["", *table], *rows]), sep="\n")
    return 0


def test_sequences(folder: Path) -> list[str]:
    """Return the test sequences that are in a folder, or all others if there are none."""
    stems = sorted(path.stem for path in folder.glob("*.txt"))
    present = [stem for stem in stems if not stem.endswith("_times")]
    if not present:
        raise BadData(f"{folder} has no pose files NN.txt: give a folder such as kitti/poses")
    return [name for name in ("03", "05", "06", "07", "10") if name in present] or present
