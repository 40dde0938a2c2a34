"""What `geovp` can be told: its verbs and their arguments; `chosen.verb` is the name of what is to be done."""

from __future__ import annotations

import argparse
from pathlib import Path

EPILOG = "Exit code: 0 all done, 1 something failed or was skipped, 2 bad input."


def parser() -> argparse.ArgumentParser:
    """All verbs with their arguments."""
    top = argparse.ArgumentParser(prog="geovp", description="Geometry-based video prediction: run, measure, look.")
    top.epilog = EPILOG
    verbs = top.add_subparsers(metavar="VERB", required=True)
    _add_run(verbs)
    _add_views(verbs)
    data = verbs.add_parser("data", help="look after data sets").add_subparsers(metavar="VERB", required=True)
    doctor = data.add_parser("doctor", help="what is there, and what is wrong with it, line by line")
    doctor.add_argument("root", type=Path, metavar="ROOT", help="a folder laid out as KITTI odometry")
    doctor.add_argument("--deep", action="store_true", help="decode every image as well")
    doctor.set_defaults(verb="doctor")
    _add_predict(verbs)
    _add_poses(verbs)
    _add_forecast(verbs)
    everything = verbs.add_parser("list", help="what is installed, by role and name")
    everything.add_argument("role", nargs="?", metavar="ROLE", help="only this role, such as renderers")
    everything.set_defaults(verb="list")
    check = verbs.add_parser("check", help="put a component through the contract tests of its role")
    check.add_argument("role", metavar="ROLE", help="such as renderers")
    check.add_argument("name", metavar="NAME", help="as `geovp list` shows it")
    check.add_argument(
        "--set", action="append", default=[], metavar="FIELD=VALUE", help="a setting, written as in TOML"
    )
    check.set_defaults(verb="check")
    return top


def _add_run(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    run = verbs.add_parser("run", help="fill what is missing or stale of a matrix; can be killed at any moment")
    run.add_argument("matrix", type=Path, metavar="MATRIX.toml")
    run.add_argument("--root", type=Path, metavar="FOLDER", help="where the data set is, instead of what the file says")
    run.add_argument("--out", type=Path, metavar="DIR", help="results folder (default: results/<name of the file>)")
    run.add_argument("--limit", type=_positive, metavar="N", help="only the first N clips")
    run.add_argument("--keep", type=_keep, default=3, metavar="N", help="keep predictions of N clips, or of all (3)")
    run.add_argument("--fresh", action="store_true", help="compute anew what another version of the code computed")
    run.add_argument("--no-report", action="store_true", help="no plots and no report")
    where = run.add_mutually_exclusive_group()
    where.add_argument("--workers", type=_positive, metavar="N", help="processes on this machine (default: this one)")
    where.add_argument("--scheduler", metavar="ADDRESS", help="a Dask cluster that sees the same folders")
    run.set_defaults(verb="run")


def _add_predict(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    predict = verbs.add_parser("predict", help="one clip in; predicted frames, poses, cloud, film strip and film out")
    predict.add_argument("path", type=Path, metavar="VIDEO|FOLDER", help="a video, or a folder of images")
    of_images = "in pixels of the images as they are stored, (0, 0) the centre of the top-left one"
    predict.add_argument(
        "--intrinsics", type=float, nargs=4, required=True, metavar=("FX", "FY", "CX", "CY"), help=of_images
    )
    predict.add_argument("--fps", type=float, metavar="HZ", help="frames a second; needed for a folder")
    predict.add_argument("--camera-height", type=float, metavar="M", help="above the road: poses and cloud in metres")
    predict.add_argument(
        "--first", type=int, metavar="N", help="the first observed frame (default: the latest possible)"
    )
    predict.add_argument("--past", type=_positive, default=10, metavar="N", help="observed frames (10)")
    predict.add_argument("--future", type=_positive, default=20, metavar="N", help="predicted frames (20)")
    predict.add_argument("--size", type=_positive, default=256, metavar="PX", help="side of the square middle (256)")
    predict.add_argument("--wide", action="store_true", help="see the whole images, not only their middle")
    predict.add_argument("--out", type=Path, metavar="DIR", help="a new folder (default: results/predict/NAME-FIRST)")
    predict.set_defaults(verb="predict")


def _add_poses(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    poses = verbs.add_parser("poses", help="track whole sequences: pose files, drift, and the path beside the real one")
    poses.add_argument("root", type=Path, metavar="ROOT", help="a folder laid out as KITTI odometry")
    poses.add_argument("frames", nargs="+", metavar="FRAMES", help="sequences or stretches of them, as 03 or 03[0:360)")
    poses.add_argument("--odometry", default="monocular", metavar="NAME", help="as `geovp list odometries` shows it")
    poses.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", help="a setting of it, as in TOML")
    poses.add_argument("--camera", type=int, metavar="K", help="the camera image_K (default: 2, else 0)")
    poses.add_argument("--out", type=Path, default=Path("results/poses"), metavar="DIR", help="where files go")
    poses.add_argument("--clips", type=_positive, metavar="N", help="instead: errors a step on clips of N frames each")
    poses.add_argument(
        "--stride", type=_positive, default=5, metavar="N", help="frames between the starts of two clips"
    )
    poses.add_argument("--size", type=_positive, default=256, metavar="PX", help="of the clips' square crops (256)")
    poses.set_defaults(verb="poses")


def _add_forecast(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    from benchmarks.studies.forecasting import command

    forecast = verbs.add_parser("forecast", help="measure forecasters on pose files alone, and fit their constants")
    command.add_verbs(forecast.add_subparsers(metavar="VERB", required=True))
    forecast.set_defaults(verb="forecast")


def _add_views(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    table = verbs.add_parser("table", help="print and write the tables of a results folder")
    table.add_argument("--format", choices=("md", "tex", "csv"), default="md", help="what is printed (default: md)")
    table.add_argument("--style", choices=("suite", "thesis"), default="suite", help="thesis: as its table 4.1, in md")
    table.set_defaults(verb="table")
    plot = verbs.add_parser("plot", help="draw the figures of a results folder")
    plot.set_defaults(verb="plot")
    report = verbs.add_parser("report", help="write report.html of a results folder")
    report.set_defaults(verb="report")
    score = verbs.add_parser("score", help="score the kept predictions again, with the metrics as they are now")
    score.add_argument("--metrics", type=Path, metavar="MATRIX.toml", help="take [metrics] from this file")
    score.add_argument("--out", type=Path, metavar="DIR", help="where to (default: DIR-rescored)")
    score.set_defaults(verb="score")
    for verb in (table, plot, report, score):
        verb.add_argument("folder", type=Path, metavar="DIR", help="a results folder that `geovp run` wrote")


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number of 1 or more")
    return number


def _keep(text: str) -> int | str:
    return text if text == "all" else max(0, int(text))
