"""Intervals of means over clips that overlap, and of paired differences: block bootstrap with corrected width.

Clips that follow each other show the same road and share frames, so a mean over N of them is worth fewer independent
ones. Blocks of neighbours are resampled within each sequence (Kuensch 1989; circular: Politis & Romano 1992), their
length follows the autocorrelation (Carlstein 1986). Percentiles of so few blocks are too narrow: the distribution is
widened by what the bootstrap of a first-order autoregression of this length and correlation falls short of its true
variance, and by Student's t with the effective number of clips less one (Zwiers & von Storch 1995). The correlation is
corrected for its bias (Marriott & Pope 1954) and taken CAUTION standard errors higher, since intervals that are too
narrow do more harm; `geovp study coverage`, by which CAUTION was chosen, shows how often they hold the truth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

from geovp_classic.types import FloatArray

LEVEL = 0.95
NUM_RESAMPLES = 2000
CAUTION = 1.35
LARGEST_CORRELATION = 0.95
MOST_WIDENED = 9.0  # the variance at most, against the bootstrap's
KIND = (
    "[low, high]: 95 % interval of the mean over clips, block bootstrap within each sequence, since neighbouring clips "
    "overlap"
)


@dataclass(frozen=True)
class Interval:
    """A mean with its interval; NaN where too few clips have a value."""

    mean: float
    low: float
    high: float
    effective: float  # how many independent clips the values are worth
    p_zero: float  # two-sided, of a true mean of zero


NOTHING = Interval(float("nan"), float("nan"), float("nan"), 0.0, float("nan"))


def sequence_of(clip: str) -> str:
    """The sequence that a clip is cut from: its name up to the last slash."""
    return clip.rpartition("/")[0]


def interval(
    values: FloatArray,  # [N], in the order in which clips were taken; NaN is left out
    sequences: npt.NDArray[np.generic],  # [N], where each is cut from
    level: float = LEVEL,
    seed: int = 0,
) -> Interval:
    """The mean and its interval; without one for fewer than three values."""
    known = np.isfinite(values)
    values, sequences = values[known], sequences[known]
    if not len(values):
        return NOTHING
    groups = [np.flatnonzero(sequences == one) for one in np.unique(sequences)]
    mean, correlation = float(values.mean()), lag_one(values, groups)
    variance = sum(len(group) ** 2 * _mean_variance(len(group), correlation) for group in groups) / len(values) ** 2
    effective = 1 / variance
    if len(values) < 3:
        return Interval(mean, float("nan"), float("nan"), effective, float("nan"))
    length = _block_length(len(values), correlation)
    expected, sums = 0.0, np.zeros(NUM_RESAMPLES)
    rng = np.random.default_rng(seed)
    for group in groups:
        block = min(length, max(1, len(group) // 2))
        sums += _resampled_sums(values[group], block, rng)
        expected += _bootstrap_variance(len(group), block, correlation)
    expected = max(expected / len(values) ** 2, variance / MOST_WIDENED)
    wider, student = np.sqrt(variance / expected), stats.t(max(effective - 1, 1))
    off = (sums / len(values) - mean) * wider
    low, high = np.quantile(off, [(1 - level) / 2, (1 + level) / 2]) * student.ppf((1 + level) / 2) / _normal(level)
    spread = float(np.std(off))
    p_zero = float(2 * student.sf(abs(mean) / spread)) if spread > 0 else float(mean == 0)
    return Interval(mean, mean + float(low), mean + float(high), effective, p_zero)


def block_interval(values: FloatArray, groups: npt.NDArray[np.generic], level: float = LEVEL) -> tuple[float, float]:
    """Only the ends of `interval`."""
    found = interval(values, groups, level)
    return found.low, found.high


def holm(p_values: FloatArray) -> FloatArray:
    """P values [K] corrected for K comparisons (Holm 1979); NaN stays and is not counted."""
    corrected = np.full(len(p_values), np.nan)
    known = np.flatnonzero(np.isfinite(p_values))
    order = known[np.argsort(p_values[known])]
    steps = p_values[order] * np.arange(len(order), 0, -1)
    corrected[order] = np.minimum(np.maximum.accumulate(steps), 1)
    return corrected


def lag_one(values: FloatArray, groups: list[npt.NDArray[np.intp]]) -> float:
    """Autocorrelation of neighbours within groups, without its bias, plus CAUTION standard errors."""
    off, count = values - values.mean(), len(values)
    square = float(off @ off)
    if square == 0 or count < 4:
        return 0.0
    found = sum(float(off[group][1:] @ off[group][:-1]) for group in groups) / square
    unbiased = (found + 1 / count) / (1 - 3 / count)
    error = np.sqrt(max(1 - min(unbiased, 1) ** 2, 0.05) / count)
    return float(np.clip(unbiased + CAUTION * error, 0, LARGEST_CORRELATION))


def _block_length(count: int, correlation: float) -> int:
    """Carlstein 1986, for a first-order autoregression."""
    share = 2 * correlation / (1 - correlation**2)
    return max(1, int(np.ceil(share ** (2 / 3) * count ** (1 / 3))))


def _resampled_sums(values: FloatArray, block: int, rng: np.random.Generator) -> FloatArray:
    """Sums [NUM_RESAMPLES] of as many values, drawn in blocks."""
    count = len(values)
    starts = rng.integers(0, count, (NUM_RESAMPLES, -(-count // block)))
    drawn = (starts[..., None] + np.arange(block)).reshape(NUM_RESAMPLES, -1)[:, :count] % count
    return np.asarray(values[drawn].sum(axis=1))


def _mean_variance(count: int, correlation: float) -> float:
    """Variance of the mean of `count` values of a first-order autoregression of variance 1."""
    lags = np.arange(1, count)
    return float(1 + 2 * ((1 - lags / count) * correlation**lags).sum()) / count


def _bootstrap_variance(count: int, block: int, correlation: float) -> float:
    """What the block bootstrap makes of the variance of their sum, on average."""
    lags = np.arange(1, block)
    within = 1 + 2 * float(((1 - lags / block) * correlation**lags).sum())
    return count * (within - block * _mean_variance(count, correlation))


def _normal(level: float) -> float:
    return float(stats.norm.ppf((1 + level) / 2))
