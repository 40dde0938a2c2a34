"""The verbs `evaluate`, `fit-kalman` and `fit-prior` of `geovp forecast`: arguments in, lines to print out.

Nothing heavy is imported before a verb's lines are asked for.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.forecasting import splits
from benchmarks.forecasting.watching import Watch


def add_verbs(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the three verbs; each sets `lines`, a function of the arguments and a Watch that yields what to print."""
    evaluate = verbs.add_parser("evaluate", help="all forecasters on windows of pose files, as a table")
    _add_input(evaluate, splits.TEST)
    evaluate.add_argument("--num-past", type=int, default=10, metavar="N", help="poses that a forecaster sees (10)")
    evaluate.add_argument("--num-future", type=int, default=20, metavar="N", help="poses that it forecasts (20)")
    evaluate.add_argument("--stride", type=int, default=5, metavar="N", help="frames between two windows' starts (5)")
    evaluate.add_argument("--only", nargs="+", metavar="ROW", help="only these rows")
    evaluate.add_argument("--coefficients", type=Path, metavar="FILE", help="a motion prior of fit-prior (packaged)")
    evaluate.add_argument(
        "--noise", type=float, default=0.0, metavar="X", help="odometry errors: X times 2 cm and 0.05 degrees a step"
    )
    evaluate.add_argument(
        "--scale-error", type=float, default=0.0, metavar="X", help="odometry errors: lengths off by X as a share"
    )
    evaluate.set_defaults(lines=_evaluate)
    kalman = verbs.add_parser("fit-kalman", help="noise of the Kalman forecasters, by maximum likelihood")
    prior = verbs.add_parser("fit-prior", help="the motion prior")
    for fit, lines in ((kalman, _fit_kalman), (prior, _fit_prior)):
        _add_input(fit, splits.TRAIN)
        fit.add_argument("--out", type=Path, required=True, metavar="FILE", help="the file to write")
        fit.set_defaults(lines=lines)
    prior.add_argument(
        "--calibrate", nargs="*", default=list(splits.VAL), metavar="NN", help="only the regions' size is set on these"
    )


def _add_input(verb: argparse.ArgumentParser, names: Sequence[str]) -> None:
    verb.add_argument("poses", type=Path, metavar="POSES_DIR", help="holds NN.txt and NN_times.txt")
    told = f"sequences ({' '.join(names)})"
    verb.add_argument("--sequences", nargs="+", default=list(names), metavar="NN", help=told)


def _evaluate(chosen: argparse.Namespace, watch: Watch) -> Iterator[str]:
    from benchmarks.forecasting import evaluation
    from benchmarks.forecasting.windows import Cut
    from geovp_classic.errors import UnknownComponent

    forecasters = evaluation.contestants(chosen.coefficients)
    wanted = chosen.only or list(forecasters)
    for name in wanted:
        if name not in forecasters:
            raise UnknownComponent(f"no row is called {name!r}: known are {', '.join(forecasters)}")
    cut = Cut(chosen.num_past, chosen.num_future, chosen.stride)
    rows = {name: forecasters[name] for name in wanted}
    spoil = evaluation.odometry_noise(chosen.noise, chosen.scale_error)
    cuts = evaluation.read_windows(chosen.poses, chosen.sequences, cut)
    yield f"{len(cuts)} windows of {', '.join(chosen.sequences)}"
    yield from evaluation.as_lines(evaluation.evaluate(cuts, rows, spoil, watch))


def _fit_kalman(chosen: argparse.Namespace, watch: Watch) -> Iterator[str]:
    from benchmarks.forecasting import evaluation, kalman_fit
    from benchmarks.forecasting.windows import Cut

    cuts = evaluation.read_windows(chosen.poses, chosen.sequences, Cut(stride=40))
    fitted, starts = {}, kalman_fit.starts()
    for done, (name, start) in enumerate(starts.items()):
        watch(done, len(starts))
        fitted[name] = kalman_fit.fit(cuts, start)
        yield f"{name}: {fitted[name]}"
    watch(len(starts), len(starts))
    chosen.out.write_text(kalman_fit.as_toml(fitted), encoding="utf-8")
    yield f"written to {chosen.out}"


def _fit_prior(chosen: argparse.Namespace, watch: Watch) -> Iterator[str]:
    import numpy as np

    from benchmarks.forecasting import prior_fit, windows
    from geovp_classic.forecasting import motion_prior

    others = windows.read(chosen.poses, chosen.calibrate)
    coefficients = prior_fit.fit(windows.read(chosen.poses, chosen.sequences), prior_fit.Plan(), others, watch)
    with chosen.out.open("wb") as stream:
        np.savez(stream, allow_pickle=False, **motion_prior.packed(coefficients))
    yield f"written to {chosen.out}"
