"""Methods that were trained with several seeds: means, and paired differences from one of them.

The methods of the results are called METHOD-SEED, as in the matrix ablation-poses. A difference is
paired by seed and clip. Its 95 % interval is that of the mean over clips, for these seeds; the
differences seed by seed show what other seeds may give.
"""

import argparse
import re
from collections.abc import Iterator

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.analysis.intervals import interval, sequences_of
from geovp_benchmarks.cli.options import add, add_shared
from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables.formats import grid
from geovp_classic.errors import BadData


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the results, the reference and the metrics."""
    add_shared(parser, "folder")
    add(parser, "reference", "METHOD", "Method that the others are compared with.")
    default = ("average-displacement", "final-displacement", "yaw-error", "psnr")
    text = f"Metrics. Default: {' '.join(default)}."
    add(parser, "--metrics", "METRIC", text, default, nargs="+")


def run(args: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """Yield a table per metric."""
    results = Results(args.folder)
    stored = results.protocol()["metrics"]
    for metric in tracked(args.metrics, len(args.metrics), progress):
        if metric not in stored:
            raise BadData(f"{results.root} has no metric {metric!r}, only {', '.join(stored)}")
        yield f"{metric} ({stored[metric]['unit']})"
        yield from grid(table(results, args.reference, metric))
        yield ""


def table(results: Results, reference: str, metric: str) -> list[list[str]]:
    """Return a head and a row per method, on the clips that all methods have."""
    scores: dict[str, dict[str, dict[str, float]]] = {}  # by method, seed and clip
    for method in results.methods():
        if match := re.fullmatch(r"(.+?)-(\d+)(--.+)?", method.name):
            samples = results.scores(method.name).means()[metric]
            values = statistics.over_steps(samples)
            by_clip = dict(zip(results.protocol()["clips"], values.tolist(), strict=True))
            scores.setdefault(match[1], {})[match[2]] = by_clip
    if reference not in scores:
        names = ", ".join(scores) or "none"
        raise BadData(
            f"{results.root} has no methods {reference}-SEED: methods with seeds are {names}"
        )
    runs = [each for seeds in scores.values() for each in seeds.values()]
    clips = [clip for clip in runs[0] if np.isfinite([run.get(clip, np.nan) for run in runs]).all()]
    arrays = {
        name: {seed: np.array([each[clip] for clip in clips]) for seed, each in seeds.items()}
        for name, seeds in scores.items()
    }
    base = arrays[reference]
    lines = [["method", "mean", "by seed", f"difference from {reference}", "by seed"]]
    for name, seeds in arrays.items():
        means = [values.mean() for values in seeds.values()]
        line = [name, f"{np.mean(means):.3f}", " ".join(f"{mean:.3f}" for mean in means), "", ""]
        gaps = [values - base[seed] for seed, values in seeds.items() if seed in base]
        if name != reference and gaps:
            whole = interval(np.mean(gaps, axis=0), sequences_of(clips))
            line[3] = f"{whole.mean:+.3f} [{whole.low:+.3f}, {whole.high:+.3f}]"
            line[4] = " ".join(f"{gap.mean():+.3f}" for gap in gaps)
        lines.append(line)
    return lines
