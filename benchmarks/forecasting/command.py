"""The verbs `evaluate`, `fit-kalman` and `fit-prior`: arguments in, lines to print out."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.forecasting import windows
from benchmarks.forecasting.windows import Cut


def add_verbs(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the three verbs; each sets `lines`, a function of the arguments that yields what to print."""
    evaluate = verbs.add_parser("evaluate", help="all forecasters on windows of pose files, as a table")
    _add_input(evaluate, windows.TEST)
    evaluate.add_argument("--num-past", type=int, default=10)
    evaluate.add_argument("--num-future", type=int, default=20)
    evaluate.add_argument("--stride", type=int, default=5, help="frames between the starts of two windows")
    evaluate.add_argument("--only", nargs="+", metavar="ROW", help="only these rows")
    evaluate.add_argument("--coefficients", type=Path, help="a motion prior of fit-prior; default: the packaged one")
    evaluate.add_argument("--noise", type=float, default=0.0, help="times 2 cm and 0.05 degrees, on every past step")
    evaluate.set_defaults(lines=_evaluate)
    for name, help_line, lines in (
        ("fit-kalman", "noise of the Kalman forecasters, by maximum likelihood", _fit_kalman),
        ("fit-prior", "the motion prior", _fit_prior),
    ):
        fit = verbs.add_parser(name, help=help_line)
        _add_input(fit, windows.TRAIN)
        fit.add_argument("--out", type=Path, required=True, help="the file to write")
        fit.set_defaults(lines=lines)


def lines(arguments: Sequence[str] | None = None) -> Iterator[str]:
    """What the command has to say, line by line as it becomes known; GeovpError for bad input."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.forecasting", description=__doc__)
    add_verbs(parser.add_subparsers(metavar="VERB", required=True))
    chosen = parser.parse_args(arguments)
    said: Iterator[str] = chosen.lines(chosen)
    return said


def _add_input(verb: argparse.ArgumentParser, names: Sequence[str]) -> None:
    verb.add_argument("poses", type=Path, metavar="POSES_DIR", help="holds NN.txt and NN_times.txt")
    verb.add_argument("--sequences", nargs="+", default=list(names), metavar="NN")


def _evaluate(chosen: argparse.Namespace) -> Iterator[str]:
    from benchmarks.forecasting import evaluation
    from geovp_classic.errors import UnknownComponent

    forecasters = evaluation.contestants(chosen.coefficients)
    wanted = chosen.only or list(forecasters)
    for name in wanted:
        if name not in forecasters:
            raise UnknownComponent(f"no row is called {name!r}: known are {', '.join(forecasters)}")
    noise = evaluation.OdometryNoise(0.02 * chosen.noise, 0.05 * chosen.noise) if chosen.noise > 0 else None
    cut = Cut(chosen.num_past, chosen.num_future, chosen.stride)
    rows = {name: forecasters[name] for name in wanted}
    table = evaluation.evaluate(chosen.poses, chosen.sequences, rows, cut, noise)
    yield f"{len(next(iter(table.values())).position_m)} windows of {', '.join(chosen.sequences)}"
    yield from evaluation.as_lines(table)


def _fit_kalman(chosen: argparse.Namespace) -> Iterator[str]:
    from benchmarks.forecasting import kalman_fit

    sequences = windows.read(chosen.poses, chosen.sequences).values()
    cuts = [window for trajectory in sequences for window in windows.windows(trajectory, Cut(stride=40))]
    fitted = {}
    for name, start in kalman_fit.starts().items():
        fitted[name] = kalman_fit.fit(cuts, start)
        yield f"{name}: {fitted[name]}"
    chosen.out.write_text(kalman_fit.as_toml(fitted), encoding="utf-8")
    yield f"written to {chosen.out}"


def _fit_prior(chosen: argparse.Namespace) -> Iterator[str]:
    from benchmarks.forecasting import prior_fit
    from geovp_classic.poses import motion_prior

    coefficients = prior_fit.fit(windows.read(chosen.poses, chosen.sequences), prior_fit.Plan())
    with chosen.out.open("wb") as stream:
        np.savez(stream, allow_pickle=False, **motion_prior.packed(coefficients))
    yield f"written to {chosen.out}"
