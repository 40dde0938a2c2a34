"""Evaluate forecasters on windows of pose files."""

import argparse
import json
from pathlib import Path

from geovp_benchmarks.arguments import add_json, positive
from geovp_benchmarks.progress import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the action and its options."""
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    parser = actions.add_parser("evaluate", help="Print errors and calibration of forecasters.")
    text = "Folder of NN.txt, with times in NN_times.txt or ../sequences/NN/times.txt."
    parser.add_argument("poses", type=Path, metavar="POSES_DIR", help=text)
    test = ("03", "05", "06", "07", "10")
    text = f"Sequences. Default: {' '.join(test)}."
    parser.add_argument("--sequences", nargs="+", default=test, metavar="NN", help=text)
    for name, default, text in (
        ("--num-past", 10, "Observed poses"),
        ("--num-future", 20, "Predicted poses"),
        ("--stride", 5, "Frames between the starts of two windows"),
    ):
        help_text = f"{text}. Default: {default}."
        parser.add_argument(name, type=positive, default=default, metavar="N", help=help_text)
    text = "Names of the forecasters. Default: all."
    parser.add_argument("--only", nargs="+", metavar="NAME", help=text)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Print a table of forecasters."""
    from geovp_benchmarks.evaluation import forecasting
    from geovp_classic.errors import UnknownComponent
    from geovp_classic.registry import nearest

    compared = forecasting.forecasters()
    for name in args.only or ():
        if name not in compared:
            raise UnknownComponent(f"--only: no forecaster {name!r}{nearest(name, compared)}")
    compared = {name: compared[name] for name in args.only or compared}
    windows = forecasting.read_windows(
        args.poses, args.sequences, args.num_past, args.num_future, args.stride
    )
    with progress_bar("forecast", "forecasts") as progress:
        scores = forecasting.evaluate(windows, compared, progress)
    table = {name: forecasting.summary(each) for name, each in scores.items()}
    if args.json:
        about = {"sequences": args.sequences, "windows": len(windows)}
        print(json.dumps({**about, "forecasters": table}, indent=2))
    else:
        print(f"{len(windows)} windows of {', '.join(args.sequences)}", "", sep="\n")
        print(*forecasting.lines(table), sep="\n")
    return 0
