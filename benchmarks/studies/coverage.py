"""Coverage of the 95 % intervals of means over clips, by simulation.

Values of mean zero depend on each other as scores of overlapping clips do: a first-order
autoregression, or a moving average as for clips that overlap w strides. The noise is normal or
skewed (exponential). The last column shows intervals as if clips were independent.
"""

import argparse
import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy import stats
from scipy.signal import lfilter

from geovp_benchmarks.analysis.intervals import interval
from geovp_benchmarks.cli.options import add
from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.tables.formats import grid

Filter = tuple[list[float], list[float]]  # numerator, denominator


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the number of draws."""
    add(parser, "--draws", "N", "Number of simulated tables per row. Default: 1000.", 1000)


def run(args: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """Yield the table."""
    dependences: dict[str, Filter] = {
        f"AR(1), {correlation}": ([1.0], [1.0, -correlation]) for correlation in (0.0, 0.5, 0.8)
    }
    for width in (3, 6):
        dependences[f"overlap, {width}"] = [1.0] * width, [1.0]
    noises = {"normal": stats.norm(), "skewed": stats.expon(loc=-1)}
    sizes = ((36,), (34, 5), (60, 40), (20, 20, 20))
    cases = list(itertools.product(sizes, dependences.items(), noises.items()))
    names = ["effective", "coverage (%)", "as independent (%)"]
    lines = [["clips", "dependence", "noise", *names]]
    for counts, (name, dependence), (noise_name, noise) in tracked(cases, len(cases), progress):
        covered, naive, effective = coverage(counts, dependence, noise, args.draws)
        numbers = [f"{value:.1f}" for value in (effective, 100 * covered, 100 * naive)]
        lines.append([" + ".join(map(str, counts)), name, noise_name, *numbers])
    yield from grid(lines)


def coverage(
    sizes: tuple[int, ...],  # clips per sequence
    dependence: Filter,
    noise: Any,  # distribution of scipy.stats
    num_draws: int,
    seed: int = 0,
    burn_in: int = 200,
) -> tuple[float, float, float]:
    """Return the coverage, that of naive intervals, and the median effective sample size."""
    rng = np.random.default_rng(seed)
    drawn = [noise.rvs((num_draws, size + burn_in), random_state=rng) for size in sizes]
    filtered = [lfilter(*dependence, each, axis=1)[:, burn_in:] for each in drawn]
    values = np.concatenate(filtered, axis=1)
    sequences = np.repeat(np.arange(len(sizes)), sizes)
    intervals = [interval(row, sequences, seed=number) for number, row in enumerate(values)]
    count = values.shape[1]
    error = values.std(axis=1, ddof=1) / np.sqrt(count)
    is_inside = np.abs(values.mean(axis=1)) <= stats.t(count - 1).ppf(0.975) * error
    covered = np.mean([each.low <= 0 <= each.high for each in intervals])
    return (
        float(covered),
        float(is_inside.mean()),
        float(np.median([i.effective for i in intervals])),
    )
