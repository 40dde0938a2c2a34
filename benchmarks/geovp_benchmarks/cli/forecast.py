"""Evaluate forecasters on windows of pose files, and fit their constants."""

import argparse
import json
from pathlib import Path
from typing import get_args

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
    parser.set_defaults(action=evaluate)
    for name, fit in (
        ("fit-kalman", fit_kalman),
        ("fit-prior", fit_prior),
        ("fit-body-motion", fit_body_motion),
        ("fit-speeds", fit_speeds),
    ):
        parser = actions.add_parser(name, help=str(fit.__doc__))
        parser.add_argument("poses", type=Path, metavar="POSES_DIR", help="Folder of NN.txt.")
        parser.add_argument("--sequences", nargs="+", default=("00", "02", "08", "09"))
        parser.add_argument("--calibrate", nargs="*", default=("01", "04"))
        if fit is not fit_speeds:
            parser.add_argument("--out", type=Path, required=True, metavar="FILE")
        parser.set_defaults(action=fit)


def run(args: argparse.Namespace) -> int:
    """Run the action."""
    args.action(args)
    return 0


def evaluate(args: argparse.Namespace) -> None:
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


def fit_kalman(args: argparse.Namespace) -> None:
    """Fit the noise of the Kalman forecasters by maximum likelihood."""
    from geovp_benchmarks.evaluation.forecasting import read_windows
    from geovp_benchmarks.fitting import kalman_noise
    from geovp_classic.forecasting import kalman

    windows = read_windows(args.poses, args.sequences, stride=200)
    fitted = {}
    for name in get_args(kalman.Constants):
        fitted[name] = kalman_noise.NoiseFit().fit(windows, kalman.fitted(name))
        print(f"{name}: {fitted[name]}")
    args.out.write_text(kalman_noise.as_toml(fitted), encoding="utf-8")


def fit_prior(args: argparse.Namespace) -> None:
    """Fit the motion prior."""
    import numpy as np

    from geovp_benchmarks.evaluation.forecasting import read_sequences
    from geovp_benchmarks.fitting import prior

    train = read_sequences(args.poses, args.sequences)
    others = read_sequences(args.poses, args.calibrate)
    with progress_bar("forecast", "steps") as progress:
        coefficients = prior.PriorFit().fit(train, others, progress)
    with args.out.open("wb") as stream:
        np.savez(stream, allow_pickle=False, **prior.packed(coefficients))


def fit_body_motion(args: argparse.Namespace) -> None:
    """Fit heave, pitch and roll over the plane."""
    import numpy as np

    from geovp_benchmarks.evaluation.forecasting import read_sequences
    from geovp_benchmarks.fitting import body_motion

    train = read_sequences(args.poses, args.sequences)
    others = read_sequences(args.poses, args.calibrate)
    coefficients = body_motion.BodyMotionFit().fit(train, others)
    with args.out.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **body_motion.packed(coefficients))


def fit_speeds(args: argparse.Namespace) -> None:
    """Fit driving speeds, for clips without a measured scale."""
    from geovp_benchmarks.evaluation.forecasting import read_sequences
    from geovp_classic.odometry import speed_prior

    train = read_sequences(args.poses, args.sequences)
    others = read_sequences(args.poses, args.calibrate)
    fitted = speed_prior.fit(train, others)
    print(f"median_m_s = {fitted.median_m_s:.1f}")
    print(f"spread = {fitted.spread:.2f}")
