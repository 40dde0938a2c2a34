"""Rows that were trained alike with several seeds: each method's mean, its seeds, and its
difference from another's.

Rows are called METHOD-SEED, as in the matrix ablation-poses. A difference is paired, seed with seed
and clip with clip; its 95 % interval is that of the mean over clips, for these seeds. What other
seeds would give is seen from the seeds' own differences, which follow it.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from geovp_benchmarks.arguments import add_results_folder
from geovp_benchmarks.progress import Progress
from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray

if TYPE_CHECKING:
    from geovp_benchmarks.results.store import Results

ROW = re.compile(r"(.+?)-(\d+)(--.+)?")  # of a method's folder: METHOD-SEED, METHOD-SEED--RENDERER
METRICS = ("average-displacement", "final-displacement", "yaw-error", "psnr")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which results, compared with which method, in which metrics."""
    add_results_folder(parser)
    parser.add_argument("reference", metavar="METHOD", help="what the others are compared with")
    parser.add_argument(
        "--metrics", nargs="+", default=METRICS, metavar="NAME", help=f"({' '.join(METRICS)})"
    )


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """A table per metric."""
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.results.stored_facts import title
    from geovp_benchmarks.tables.formats import columns

    results = Results(chosen.folder)
    known = results.protocol()["metrics"]
    for done, metric in enumerate(chosen.metrics, 1):
        if metric not in known:
            raise BadData(f"{results.root} has no metric {metric!r}: known are {', '.join(known)}")
        better = {True: ", higher is better", False: ", lower is better"}.get(
            known[metric]["higher_is_better"], ""
        )
        unit = f" ({known[metric]['unit']})" if known[metric]["unit"] else ""
        yield f"{title(metric)}{unit}{better}"
        yield from columns(table(results, chosen.reference, metric))
        yield ""
        progress(done, len(chosen.metrics))


def table(results: Results, reference: str, metric: str) -> list[list[str]]:
    """A head and a line per method: mean over seeds and clips, each seed's, and the differences
    from the reference.
    """
    from geovp_benchmarks.analysis.intervals import interval, sequences_of

    found = by_seed(results, metric)
    if reference not in found:
        raise BadData(
            f"{results.root} has no methods {reference}-SEED: methods with seeds are "
            f"{', '.join(found) or 'none'}"
        )
    lines = [["method", "mean", "its seeds", f"difference from {reference}", "seed by seed"]]
    for method, seeds in found.items():
        means = [float(np.mean([*clips.values()])) for clips in seeds.values()]
        line = [method, f"{np.mean(means):.3f}", " ".join(f"{mean:.3f}" for mean in means)]
        shared = [seed for seed in seeds if seed in found[reference]]
        if method != reference and shared:
            clips = [
                clip
                for clip in seeds[shared[0]]
                if all(clip in found[m][s] for m in (method, reference) for s in shared)
            ]
            off = np.array(
                [[seeds[s][clip] - found[reference][s][clip] for clip in clips] for s in shared]
            )  # [S, N]
            whole = interval(off.mean(axis=0), sequences_of(clips))
            line += [
                f"{whole.mean:+.3f} [{whole.low:+.3f}, {whole.high:+.3f}]",
                " ".join(f"{x:+.3f}" for x in off.mean(axis=1)),
            ]
        lines.append(line + [""] * (len(lines[0]) - len(line)))
    return lines


def by_seed(results: Results, metric: str) -> dict[str, dict[int, Mapping[str, float]]]:
    """The value of each clip, its mean over steps, by method and seed; clips without one are left
    out.
    """
    from geovp_benchmarks.analysis import statistics

    found: dict[str, dict[int, Mapping[str, float]]] = {}
    for method in results.methods():
        if match := ROW.fullmatch(method.name):
            cube = statistics.cube(results.scores(method.name), metric)
            values: FloatArray = statistics.over_steps(statistics.mean_of_samples(cube, True))
            clips = {
                clip: float(value)
                for clip, value in zip(cube.clips, values, strict=True)
                if np.isfinite(value)
            }
            if clips:
                found.setdefault(match[1], {})[int(match[2])] = clips
    return found
