"""Measure forecasters on pose files alone."""

import argparse
from collections.abc import Iterator
from pathlib import Path

from geovp_benchmarks.arguments import add_json, figure_file
from geovp_benchmarks.progress import Progress

TEST = "03 05 06 07 10"  # of KITTI odometry, as in DeepVO's paper


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verbs `evaluate` and `best-of`; each sets `lines`, a function with the arguments of
    `run`.
    """
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    evaluate = verbs.add_parser(
        "evaluate", help="all forecasters on windows of pose files, as a table"
    )
    _add_input(evaluate)
    evaluate.add_argument(
        "--num-past", type=int, default=10, metavar="N", help="poses that a forecaster sees (10)"
    )
    evaluate.add_argument(
        "--num-future", type=int, default=20, metavar="N", help="poses that it forecasts (20)"
    )
    evaluate.add_argument(
        "--stride", type=int, default=5, metavar="N", help="frames between two windows' starts (5)"
    )
    evaluate.add_argument("--only", nargs="+", metavar="METHOD", help="only these methods")
    evaluate.add_argument(
        "--coefficients", type=Path, metavar="FILE", help="a fitted motion prior (packaged)"
    )
    evaluate.add_argument(
        "--noise",
        type=float,
        default=0.0,
        metavar="X",
        help="odometry errors: X times 2 cm and 0.05 degrees a step",
    )
    evaluate.add_argument(
        "--scale-error",
        type=float,
        default=0.0,
        metavar="X",
        help="odometry errors: lengths off by the fraction X",
    )
    picture = "also draw a reliability diagram of the predictive distributions (.png, .pdf, .svg)"
    evaluate.add_argument("--plot", type=figure_file, metavar="FILE", help=picture)
    add_json(evaluate)
    evaluate.set_defaults(lines=_evaluate)
    best = verbs.add_parser(
        "best-of", help="the nearest of a few futures, drawn and representative, as a table"
    )
    _add_input(best)
    best.add_argument(
        "--stride",
        type=int,
        default=20,
        metavar="N",
        help="frames between two windows' starts (20)",
    )
    best.add_argument(
        "--counts",
        type=int,
        nargs="+",
        default=[1, 5, 10, 20],
        metavar="K",
        help="futures (1 5 10 20)",
    )
    best.set_defaults(lines=_best_of)


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """The lines of the chosen verb."""
    yield from chosen.lines(chosen, progress)


def _add_input(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "poses",
        type=Path,
        metavar="POSES_DIR",
        help="NN.txt, times in NN_times.txt or ../sequences",
    )
    verb.add_argument(
        "--sequences", nargs="+", default=TEST.split(), metavar="NN", help=f"sequences ({TEST})"
    )


def _evaluate(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    from geovp_benchmarks.evaluation.forecasting import evaluation, tables
    from geovp_classic.errors import UnknownComponent

    forecasters = evaluation.forecasters(chosen.coefficients)
    for name in chosen.only or ():
        if name not in forecasters:
            raise UnknownComponent(
                f"no method is called {name!r}: known are {', '.join(forecasters)}"
            )
    rows = {name: forecasters[name] for name in chosen.only or forecasters}
    corruption = None
    if chosen.noise > 0 or chosen.scale_error > 0:
        corruption = evaluation.OdometryNoise(
            0.02 * chosen.noise, 0.05 * chosen.noise, chosen.scale_error
        )
    windows = evaluation.read_windows(
        chosen.poses, chosen.sequences, chosen.num_past, chosen.num_future, chosen.stride
    )
    scores = evaluation.evaluate(windows, rows, corruption, progress)
    if chosen.plot is not None:
        from geovp_benchmarks.evaluation.forecasting.reliability import reliability_figure

        reliability_figure(scores).savefig(chosen.plot, bbox_inches="tight")
    if chosen.json:
        yield tables.as_json(scores, chosen.sequences)
        return
    yield f"{len(windows)} windows of {', '.join(chosen.sequences)}"
    yield from tables.as_lines(scores)


def _best_of(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    from geovp_benchmarks.evaluation.forecasting import best_of
    from geovp_benchmarks.evaluation.forecasting.evaluation import read_windows
    from geovp_classic.errors import BadData

    if min(chosen.counts) < 1:
        raise BadData(f"--counts {min(chosen.counts)}: expected 1 or more futures")
    windows = {
        name: read_windows(chosen.poses, [name], stride=chosen.stride) for name in chosen.sequences
    }
    flat, names = zip(
        *((window, name) for name, each in windows.items() for window in each), strict=True
    )
    yield f"{len(flat)} windows of {', '.join(chosen.sequences)}"
    table = best_of.errors(flat, best_of.forecasters(), chosen.counts, progress)
    yield from best_of.as_lines(table, chosen.counts, names)
