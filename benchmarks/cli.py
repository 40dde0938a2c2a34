"""The command line: `geovp run | table | plot | report | score | predict | poses | forecast | data | list | check`.

Nothing heavy is imported before a verb is chosen, so that `--help` answers at once. Exit code 0 when all was done,
1 when some of it failed or was skipped, 2 for bad input, which is told in one sentence.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from geovp_classic.errors import BadData, GeovpError

if TYPE_CHECKING:
    from benchmarks.executors import Executor
    from benchmarks.matrix import Matrix
    from benchmarks.measures import Measures
    from benchmarks.store import Cell, Results

DONE, INCOMPLETE, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
EPILOG = "Exit code: 0 all done, 1 something failed or was skipped, 2 bad input."


def main(arguments: Sequence[str] | None = None) -> int:
    """Do what the arguments say and return the exit code."""
    chosen = parser().parse_args(arguments)
    try:
        code: int = chosen.verb(chosen)
    except GeovpError as error:
        print(f"geovp: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("\ngeovp: interrupted; what was done is kept, the same command goes on from there", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has seen enough
        sys.stderr.close()
        return DONE
    return code


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
    doctor.add_argument("--deep", action="store_true", help="decode every picture as well")
    doctor.set_defaults(verb=_doctor)
    _add_predict(verbs)
    _add_poses(verbs)
    _add_forecast(verbs)
    everything = verbs.add_parser("list", help="what is installed, by role and name")
    everything.add_argument("role", nargs="?", metavar="ROLE", help="only this role, such as renderers")
    everything.set_defaults(verb=_list)
    check = verbs.add_parser("check", help="put a component through the contract tests of its role")
    check.add_argument("role", metavar="ROLE", help="such as renderers")
    check.add_argument("name", metavar="NAME", help="as `geovp list` shows it")
    check.add_argument(
        "--set", action="append", default=[], metavar="FIELD=VALUE", help="a setting, written as in TOML"
    )
    check.set_defaults(verb=_check)
    return top


def _add_run(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    run = verbs.add_parser("run", help="fill what is missing or stale of a matrix; can be killed at any moment")
    run.add_argument("matrix", type=Path, metavar="MATRIX.toml")
    run.add_argument("--root", type=Path, metavar="FOLDER", help="where the data set is, instead of what the file says")
    run.add_argument("--out", type=Path, metavar="DIR", help="results folder (default: results/<name of the file>)")
    run.add_argument("--limit", type=_positive, metavar="N", help="only the first N clips")
    run.add_argument("--keep", type=_keep, default=3, metavar="N", help="keep predictions of N clips, or of all (3)")
    run.add_argument("--no-report", action="store_true", help="no plots and no report")
    where = run.add_mutually_exclusive_group()
    where.add_argument("--workers", type=_positive, metavar="N", help="processes on this machine (default: this one)")
    where.add_argument("--scheduler", metavar="ADDRESS", help="a Dask cluster that sees the same folders")
    run.set_defaults(verb=_run)


def _add_predict(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    predict = verbs.add_parser("predict", help="one clip in; predicted frames, poses, cloud, film strip and film out")
    predict.add_argument("path", type=Path, metavar="VIDEO|FOLDER", help="a video, or a folder of pictures")
    of_pictures = "in pixels of the pictures as they are stored, (0, 0) the centre of the top-left one"
    predict.add_argument(
        "--intrinsics", type=float, nargs=4, required=True, metavar=("FX", "FY", "CX", "CY"), help=of_pictures
    )
    predict.add_argument("--fps", type=float, metavar="HZ", help="frames a second; needed for a folder")
    predict.add_argument("--camera-height", type=float, metavar="M", help="above the road: poses and cloud in metres")
    predict.add_argument(
        "--first", type=int, metavar="N", help="the first observed frame (default: the latest possible)"
    )
    predict.add_argument("--past", type=_positive, default=10, metavar="N", help="observed frames (10)")
    predict.add_argument("--future", type=_positive, default=20, metavar="N", help="predicted frames (20)")
    predict.add_argument("--size", type=_positive, default=256, metavar="PX", help="side of the square middle (256)")
    predict.add_argument("--wide", action="store_true", help="see the whole pictures, not only their middle")
    predict.add_argument("--out", type=Path, metavar="DIR", help="a new folder (default: results/predict/NAME-FIRST)")
    predict.set_defaults(verb=_predict)


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
    poses.set_defaults(verb=_poses)


def _add_forecast(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    from benchmarks.forecasting import command

    forecast = verbs.add_parser("forecast", help="measure forecasters on pose files alone, and fit their constants")
    command.add_verbs(forecast.add_subparsers(metavar="VERB", required=True))
    forecast.set_defaults(verb=_forecast)


def _add_views(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    table = verbs.add_parser("table", help="print and write the tables of a results folder")
    table.add_argument("--format", choices=("md", "tex", "csv"), default="md", help="what is printed (default: md)")
    table.set_defaults(verb=_table)
    plot = verbs.add_parser("plot", help="draw the figures of a results folder")
    plot.set_defaults(verb=_plot)
    report = verbs.add_parser("report", help="write report.html of a results folder")
    report.set_defaults(verb=_report)
    score = verbs.add_parser("score", help="score the kept predictions again, with the metrics as they are now")
    score.add_argument("--metrics", type=Path, metavar="MATRIX.toml", help="take [metrics] from this file")
    score.add_argument("--out", type=Path, metavar="DIR", help="where to (default: DIR-rescored)")
    score.set_defaults(verb=_score)
    for verb in (table, plot, report, score):
        verb.add_argument("folder", type=Path, metavar="DIR", help="a results folder that `geovp run` wrote")


def _run(chosen: argparse.Namespace) -> int:
    from benchmarks import matrix as matrices
    from benchmarks.planning import Options
    from benchmarks.run import run
    from benchmarks.store import Results

    matrix = matrices.read(chosen.matrix).with_root(chosen.root)
    results = Results(chosen.out or Path("results") / matrix.name)
    options = Options(chosen.limit, None if chosen.keep == "all" else chosen.keep)
    with Bar(matrix.name, "predictions") as bar:
        cells = run(matrix, results, options, _executor(chosen), bar.show)
    return _conclude(results, cells, draw=not chosen.no_report)


def _executor(chosen: argparse.Namespace) -> Executor:
    from geovp_classic import registry

    spec: dict[str, object] = {"name": "serial"}
    if chosen.workers is not None and chosen.workers > 1:
        spec = {"name": "processes", "workers": chosen.workers}
    if chosen.scheduler is not None:
        spec = {"name": "dask", "address": chosen.scheduler}
    executor: Executor = registry.build("executors", spec)
    return executor


def _conclude(results: Results, cells: Sequence[Cell], draw: bool) -> int:
    """Print the table, write all views, and say what came of the cells."""
    from benchmarks import tables

    print(tables.markdown(tables.build(results)[0]))
    tables.write_all(results)
    print(f"tables: {results.tables}")
    if draw and any(cell.num_clips for cell in cells):
        _draw(results)
        print(f"plots:  {results.plots}")
        print(f"report: {results.report}")
    left = [cell for cell in cells if cell.status != "done"]
    if left:
        print(f"geovp: {len(left)} of {len(cells)} cells are not done: see below the table", file=sys.stderr)
    return INCOMPLETE if left else DONE


def _draw(results: Results) -> None:
    from benchmarks import report

    with Bar("plots", "figures") as bar:
        report.write_with_plots(results.root, lambda done, total, what: bar.show(done, total))


def _predict(chosen: argparse.Namespace) -> int:
    from benchmarks import prediction

    if chosen.out is not None:
        prediction.check_free(chosen.out)
    wanted = prediction.Wanted(
        path=chosen.path,
        intrinsics=tuple(chosen.intrinsics),
        rate_hz=chosen.fps,
        camera_height_m=chosen.camera_height,
        first=chosen.first,
        num_past=chosen.past,
        num_future=chosen.future,
        size_px=chosen.size,
        with_wide=chosen.wide,
    )
    with Bar("predict", "stages") as bar:
        predicted = prediction.predict(wanted, bar.show)
        name = f"{chosen.path.resolve().stem}-{predicted.first:06d}"
        written = prediction.write(predicted, chosen.out or Path("results/predict") / name)
        bar.show(prediction.NUM_STAGES, prediction.NUM_STAGES)
    for path in written:
        print(path)
    return DONE


def _poses(chosen: argparse.Namespace) -> int:
    from benchmarks import odometry_paths

    spec = {"name": chosen.odometry, **_settings(chosen.set)}
    if chosen.clips is not None:
        return _clips(chosen, spec)
    with Bar("poses", "frames") as bar:
        found = list(odometry_paths.track(chosen.root, chosen.frames, spec, chosen.camera, bar.show))
    for tracked in found:
        print(f"{tracked.frames}: {tracked.tracked.mean():.1%} of {len(tracked.tracked)} frames tracked")
        rows = tracked.rows()
        for line in _columns([odometry_paths.COLUMNS, *rows]) if rows else ["no real poses to compare with"]:
            print("  " + line)
        for path in odometry_paths.write(tracked, chosen.out):
            print(f"  {path}")
    return DONE


def _clips(chosen: argparse.Namespace, spec: dict[str, object]) -> int:
    from benchmarks import odometry_clips

    if chosen.clips < 2:
        raise BadData(f"--clips is {chosen.clips}, expected 2 frames or more: one has no motion")
    cut = odometry_clips.Cut(chosen.clips, chosen.stride, (chosen.size, chosen.size), chosen.camera)
    with Bar("clips", "clips") as bar:
        found = list(odometry_clips.measure(chosen.root, chosen.frames, spec, cut, bar.show))
    rows = [steps.row(frames) for frames, steps in found]
    print(*_columns([odometry_clips.COLUMNS, *rows]), sep="\n")
    return DONE


def _forecast(chosen: argparse.Namespace) -> int:
    with Bar("forecast", "steps") as bar:
        for line in chosen.lines(chosen, bar.show):
            print(line, flush=True)
    return DONE


def _table(chosen: argparse.Namespace) -> int:
    from benchmarks import tables
    from benchmarks.store import Results

    results = Results(chosen.folder)
    formats = {"md": tables.markdown, "tex": tables.latex, "csv": tables.comma_separated}
    for table in tables.build(results):
        print(formats[chosen.format](table))
    tables.write_all(results)
    return DONE


def _plot(chosen: argparse.Namespace) -> int:
    from benchmarks import plots

    with Bar("plots", "figures") as bar:
        written = plots.write_all(chosen.folder, lambda done, total, what: bar.show(done, total))
    for path in written:
        print(path)
    return DONE


def _report(chosen: argparse.Namespace) -> int:
    from benchmarks import report

    with Bar("report", "figures") as bar:
        path = report.write(chosen.folder, lambda done, total, what: bar.show(done, total))
    print(path)
    return DONE


def _score(chosen: argparse.Namespace) -> int:
    from benchmarks.rescoring import rescore
    from benchmarks.store import Results

    results = Results(chosen.folder)
    into = Results(chosen.out or chosen.folder.with_name(f"{chosen.folder.resolve().name}-rescored"))
    if into.root.resolve() == results.root.resolve():
        raise BadData(f"--out {into.root} is the folder that is scored: give another one, stored rows stay as they are")
    with Bar("score", "cells") as bar:
        cells = rescore(results, into, _measures(results, chosen.metrics), bar.show)
    return _conclude(into, cells, draw=False)


def _measures(results: Results, path: Path | None) -> Measures:
    from benchmarks import matrix as matrices
    from benchmarks.measures import Measures
    from benchmarks.rescoring import stored_measures

    if path is None:
        return stored_measures(results)
    matrix: Matrix = matrices.read(path)
    return Measures.build(matrix.frame_metrics, matrix.trajectory_metrics)


def _doctor(chosen: argparse.Namespace) -> int:
    from geovp_classic.data import doctor

    found = doctor.examine(chosen.root, deep=chosen.deep, watch=_watched)
    rows = [summary.cells() for summary in found.sequences]
    for line in _columns([list(rows[0]), *(list(row.values()) for row in rows)]):
        print(line)
    print()
    for finding in found.findings:
        print(f"{finding.severity}: {finding}")
    print(f"named splits whose frames are all here: {', '.join(found.usable_splits) or 'none'}")
    return DONE if found.is_sound else INCOMPLETE


def _watched(names: list[str]) -> Iterable[str]:
    with Bar("doctor", "sequences") as bar:
        for number, name in enumerate(names):
            bar.show(number, len(names))
            yield name
        bar.show(len(names), len(names))


def _list(chosen: argparse.Namespace) -> int:
    from benchmarks.listing import listed
    from geovp_classic import registry

    for role in [chosen.role] if chosen.role else registry.ROLES:
        print(role)
        for entry in listed(role):
            brought = f"[{entry.package}]" if entry.package != "geovp-classic" else ""
            print("  " + " ".join(filter(None, (entry.name, brought, entry.remark))))
    return DONE


def _check(chosen: argparse.Namespace) -> int:
    from geovp_classic import contracts, registry

    component = registry.build(chosen.role, {"name": chosen.name, **_settings(chosen.set)})
    findings = contracts.check(chosen.role, component)
    for finding in findings:
        detail = f": {finding.detail}" if finding.detail else ""
        print(f"{'kept  ' if finding.passed else 'BROKEN'}  {finding.name}{detail}")
    broken = sum(not finding.passed for finding in findings)
    print(f"{chosen.name}: {broken} of {len(findings)} promises broken")
    return INCOMPLETE if broken else DONE


def _settings(texts: Sequence[str]) -> dict[str, object]:
    import tomllib

    try:
        return tomllib.loads("\n".join(texts))
    except tomllib.TOMLDecodeError as error:
        raise BadData(f"--set {' '.join(texts)!r} is not FIELD=VALUE with a value as in TOML ({error})") from error


def _columns(lines: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, texts)) for texts in zip(*lines, strict=True)]
    return ["  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip() for line in lines]


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number of 1 or more")
    return number


def _keep(text: str) -> int | str:
    return text if text == "all" else max(0, int(text))


class Bar:
    """A progress bar on standard error that appears only when there is something to wait for."""

    def __init__(self, what: str, unit: str) -> None:
        """`what` is being done, counted in `unit`."""
        self._what, self._unit = what, unit
        self._update: Callable[[int], object] | None = None
        self._close: Callable[[], object] | None = None
        self._shown = 0

    def show(self, done: int, total: int) -> None:
        """So many are done."""
        if self._update is None and total:
            from tqdm import tqdm

            bar = tqdm(total=total, desc=self._what, unit=f" {self._unit}", file=sys.stderr, delay=0.5)
            self._update, self._close = bar.update, bar.close
        if self._update is not None:
            self._update(done - self._shown)
            self._shown = done

    def __enter__(self) -> Bar:
        """Begin."""
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Leave the last state on the screen."""
        if self._close is not None:
            self._close()


if __name__ == "__main__":
    sys.exit(main())
