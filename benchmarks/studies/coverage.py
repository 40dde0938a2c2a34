"""How often 95 % intervals of means over clips hold the truth, by simulation on data like
overlapping clips' scores.

Values of mean zero: a first-order autoregression, or a moving average, as of clips of L frames
every L / w frames, with normal or skewed (exponential) noise, cut into sequences. Beside the
intervals of the tables stands what mean and standard error over clips as if they were independent
would give.
"""

import argparse
from collections.abc import Callable, Iterator

import numpy as np

from geovp_benchmarks.arguments import positive
from geovp_benchmarks.progress import Progress
from geovp_classic.types import FloatArray

SIZES = ((36,), (34, 5), (60, 40), (20, 20, 20))  # clips a sequence
CORRELATIONS = (0.0, 0.5, 0.8)
WIDTHS = (3, 6)  # overlapping clips: a window of that many strides
BURN_IN = 200

Noise = Callable[[np.random.Generator, tuple[int, int]], FloatArray]
NOISES: dict[str, Noise] = {
    "normal": lambda rng, shape: rng.standard_normal(shape),
    "skewed": lambda rng, shape: rng.exponential(1.0, shape) - 1,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """How many draws."""
    parser.add_argument(
        "--draws", type=positive, default=1000, metavar="N", help="simulated tables a line (1000)"
    )


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """The table."""
    heads = f"{'clips':<16}{'dependence':<16}{'noise':<8}"
    yield f"{heads}{'effective':>10}{'coverage (%)':>14}{'as independent (%)':>20}"
    lines = [
        (sizes, name, filters, noise)
        for sizes in SIZES
        for name, filters in dependences().items()
        for noise in NOISES
    ]
    for number, (sizes, name, filters, noise) in enumerate(lines):
        covered, naive, effective = coverage(sizes, filters, NOISES[noise], chosen.draws)
        progress(number + 1, len(lines))
        sequences = " + ".join(map(str, sizes))
        case = f"{sequences:<16}{name:<16}{noise:<8}"
        yield f"{case}{effective:10.1f}{100 * covered:14.1f}{100 * naive:20.1f}"


def dependences() -> dict[str, tuple[FloatArray, FloatArray]]:
    """Filters (numerator, denominator) of the noise, by name."""
    found: dict[str, tuple[FloatArray, FloatArray]]
    found = {f"AR(1), {one:.1f}": (np.ones(1), np.array([1.0, -one])) for one in CORRELATIONS}
    found.update({f"overlap, {width}": (np.ones(width), np.ones(1)) for width in WIDTHS})
    return found


def coverage(
    sizes: tuple[int, ...],
    filters: tuple[FloatArray, FloatArray],
    noise: Noise,
    draws: int,
    seed: int = 0,
) -> tuple[float, float, float]:
    """The share of draws whose interval holds zero, that of naive intervals, and the median
    effective number.
    """
    from scipy import stats
    from scipy.signal import lfilter

    from geovp_benchmarks.analysis.intervals import interval

    rng = np.random.default_rng(seed)
    parts = [
        lfilter(*filters, noise(rng, (draws, size + BURN_IN)), axis=1)[:, BURN_IN:]
        for size in sizes
    ]
    values, sequences = np.concatenate(parts, axis=1), np.repeat(np.arange(len(sizes)), sizes)
    found = [interval(row, sequences, seed=number) for number, row in enumerate(values)]
    count = values.shape[1]
    reach = stats.t(count - 1).ppf(0.975) * values.std(axis=1, ddof=1) / np.sqrt(count)
    held = np.mean([one.low <= 0 <= one.high for one in found])
    return (
        float(held),
        float(np.mean(np.abs(values.mean(axis=1)) <= reach)),
        float(np.median([o.effective for o in found])),
    )
