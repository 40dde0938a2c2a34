"""The command line: `geovp run | table | plot | report | score | predict | poses | forecast | data | list | check`.

Nothing heavy is imported before a verb is chosen, so that `--help` answers at once. Exit code 0 when all was done,
1 when some of it failed or was skipped, 2 for bad input, which is told in one sentence.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks import arguments
from benchmarks.progress import Bar
from geovp_classic.errors import BadData, GeovpError

if TYPE_CHECKING:
    from benchmarks.executors import Executor
    from benchmarks.matrix import Matrix
    from benchmarks.measures import Measures
    from benchmarks.store import Cell, Results

DONE, INCOMPLETE, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


def main(given: Sequence[str] | None = None) -> int:
    """Do what the arguments say and return the exit code."""
    chosen = arguments.parser().parse_args(given)
    try:
        code = VERBS[chosen.verb](chosen)
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


def _run(chosen: argparse.Namespace) -> int:
    from benchmarks import matrix as matrices
    from benchmarks.planning import Options
    from benchmarks.run import run
    from benchmarks.store import Results

    matrix = matrices.read(chosen.matrix).with_root(chosen.root)
    results = Results(chosen.out or Path("results") / matrix.name)
    options = Options(chosen.limit, None if chosen.keep == "all" else chosen.keep, chosen.fresh)
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
    from benchmarks import formats, tables

    print(formats.markdown(tables.build(results)[0]))
    formats.write_all(results)
    print(f"tables: {results.tables}")
    if draw and any(cell.num_clips for cell in cells):
        _draw(results)
        print(f"plots:  {results.plots}")
        print(f"report: {results.report}")
    outdated = sum(cell.num_outdated > 0 for cell in cells)
    if outdated:
        print(
            f"geovp: {outdated} of {len(cells)} cells hold rows that another version of the code computed (named "
            "below the table): `geovp run --fresh` computes them anew",
            file=sys.stderr,
        )
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
    from benchmarks import formats, tables, thesis
    from benchmarks.store import Results

    results = Results(chosen.folder)
    if chosen.style == "thesis":
        if chosen.format != "md":
            raise BadData(f"--style thesis is written as md alone, not as {chosen.format}: leave --format out")
        print(thesis.markdown(results))
        return DONE
    for table in tables.build(results):
        print(formats.FORMATS[chosen.format](table))
    formats.write_all(results)
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
    for line in _columns([list(found.rows[0]), *(list(row.values()) for row in found.rows)]):
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


VERBS: Mapping[str, Callable[[argparse.Namespace], int]] = {
    "check": _check,
    "doctor": _doctor,
    "forecast": _forecast,
    "list": _list,
    "plot": _plot,
    "poses": _poses,
    "predict": _predict,
    "report": _report,
    "run": _run,
    "score": _score,
    "table": _table,
}


if __name__ == "__main__":
    sys.exit(main())
