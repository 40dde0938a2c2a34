"""Intervals of means over clips that overlap, and of paired differences: block bootstrap with
corrected width.

Clips that follow each other show the same road and share frames, so a mean over N of them is worth
fewer independent ones: N / tau, with tau the integrated autocorrelation time (Sokal 1997), summed
while correlation is visible and then continued geometrically; it is corrected for the means having
been taken out (Marriott & Pope 1954). Blocks of neighbours are resampled within each sequence
(Kuensch 1989; circular: Politis & Romano 1992). With so few blocks their percentiles are too
narrow: the distribution is widened to the standard error of the equal-weighted cosine estimator
(Mueller 2007; Lazarus et al. 2018), which looks at the slowest changes of the values alone, and to
Student's t, with as many degrees of freedom as there are of them. An interval is one for these
sequences; what others would give cannot be told from a few. `geovp study coverage` shows how often
such intervals hold the truth.
"""

import functools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import fft, special

from geovp_classic.types import FloatArray

LEVEL = 0.95
NUM_RESAMPLES = 2000
Bounds = tuple[float, float]
UNBOUNDED: Bounds = (-np.inf, np.inf)
VISIBLE = 1.5  # standard errors of a correlation that count
LARGEST_CORRELATION, LARGEST_DECAY = 0.97, 0.95
FEWEST_EFFECTIVE = 4.0  # independent clips
SLOW_SHARE, FEWEST_SLOW = 0.15, 2.0  # cosines, per independent clip and at least
LEAST_ERROR = 0.6  # of the standard error that independent values would have
SHORT = 3  # clips
LEAST_P = 1e-4  # fewer resamples than its inverse tell nothing of less
P_VALUES = (*np.geomspace(LEAST_P, 0.999, 200).tolist(), 1 - LEVEL)  # that are told apart
MOST_LOST = 0.5  # share of the variance that is taken to have gone with the means
KIND = (
    "[low, high]: 95 % interval of the mean over clips, block bootstrap within each sequence, "
    "since neighbouring clips "
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


def sequences_of(clips: Iterable[str]) -> npt.NDArray[np.str_]:
    """The sequence [N] of every clip."""
    return np.array([sequence_of(clip) for clip in clips])


def interval(
    values: FloatArray,  # [N], in the order in which clips were taken; NaN is left out
    sequences: npt.NDArray[np.generic],  # [N], where each is cut from
    level: float = LEVEL,
    seed: int = 0,
    bounds: Bounds = UNBOUNDED,
) -> Interval:
    """The mean and its interval; without one for fewer than three values.

    It is cut at `bounds`, the lowest and highest value that there can be: the true mean lies
    between them, so that the interval holds it as often as before.
    """
    known = np.isfinite(values)
    values, sequences = values[known], sequences[known]
    if not len(values):
        return NOTHING
    long, short = _groups(sequences)
    groups = [*long, short] if len(short) else long
    mean, count = float(values.mean()), len(values)
    tau, visible = autocorrelation_time(values, groups)
    if count < 3:
        return Interval(mean, float("nan"), float("nan"), count / tau, float("nan"))
    rng = np.random.default_rng(seed)
    sums = np.zeros(NUM_RESAMPLES)
    for group in groups:
        sums += _resampled_sums(values[group], min(visible + 1, len(group)), rng)
    off = sums / count - mean
    error, degrees = standard_error(values, [*long, *short[:, None]], tau)
    error = max(
        error, LEAST_ERROR * float(values.std(ddof=1)) / np.sqrt(count)
    )  # few slow cosines can be small by chance
    off *= error / off.std() if off.std() > 0 else 0.0
    low, high = np.clip(mean + _ends(off, degrees, (1 - level,))[:, 0], *bounds)
    return Interval(mean, float(low), float(high), count / tau, _p_zero(mean, off, degrees))


def standard_error(
    values: FloatArray,  # [N]
    groups: list[npt.NDArray[np.intp]],  # the clips of each sequence
    tau: float,
) -> tuple[float, int]:
    """The standard error of the mean of dependent values, and its degrees of freedom.

    From the differences of the sequences' means and each sequence's slowest cosines; what a
    first-order autoregression of autocorrelation time `tau` has less of them than of the mean is
    added.
    """
    off, count, correlation = values - values.mean(), len(values), (tau - 1) / (tau + 1)
    powers, expected, num = 0.0, -1.0, -1
    for group in groups:
        slow = min(
            round(max(FEWEST_SLOW, SLOW_SHARE * count / tau) * len(group) / count), len(group) - 1
        )
        angles = np.pi * np.arange(slow + 1) / len(group)
        share = (1 - correlation) ** 2 / (1 - 2 * correlation * np.cos(angles) + correlation**2)
        powers += float((fft.dct(off[group], norm="ortho")[: slow + 1] ** 2).sum())
        expected, num = expected + float(share.sum()), num + slow + 1
    return float(np.sqrt(powers / expected / count)), num


def _ends(off: FloatArray, degrees: int, misses: tuple[float, ...]) -> FloatArray:
    """Ends [2, K] of the intervals that miss the truth in these shares [K] of cases,
    less the mean.
    """
    tails, widening = _tails(degrees, misses)
    places = np.stack([1 - tails, tails]) * (len(off) - 1)
    return np.asarray(np.interp(places, np.arange(len(off)), np.sort(off)) * widening)


@functools.cache
def _tails(degrees: int, misses: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Upper quantiles [K], and how much farther out Student's t has them than the normal
    distribution.
    """
    tails = 1 - np.array(misses) / 2
    return tails, special.stdtrit(degrees, tails) / special.ndtri(tails)


def _p_zero(mean: float, off: FloatArray, degrees: int) -> float:
    """The largest share of misses at which the interval still holds zero, down to LEAST_P."""
    if not off.any():
        return float(mean == 0)
    low, high = mean + _ends(off, degrees, P_VALUES)
    return float(max(np.array(P_VALUES)[(low <= 0) & (high >= 0)], default=LEAST_P))


def block_interval(
    values: FloatArray, groups: npt.NDArray[np.generic], level: float = LEVEL
) -> tuple[float, float]:
    """Only the ends of `interval`."""
    found = interval(values, groups, level)
    return found.low, found.high


def autocorrelation_time(
    values: FloatArray, groups: list[npt.NDArray[np.intp]]
) -> tuple[float, int]:
    """Tau, from 1 for independent values to N / FEWEST_EFFECTIVE, and at how many lags correlation
    is visible.
    """
    off, count, tau, visible = _within(values, groups), len(values), 1.0, 0
    variance = float(off @ off) / count
    lags = range(1, max(len(group) for group in groups) // 3 + 1)
    if variance <= 1e-12 * float(values @ values) / count or not lags:
        return tau, visible
    found = np.array([_product(off, groups, lag) / variance for lag in lags])
    for _ in range(4):  # the means that were taken out lower all of them
        lost = min(tau * len(groups) / count, MOST_LOST)
        correlation = np.minimum(found + lost * (1 - found), LARGEST_CORRELATION)
        hidden = np.flatnonzero(correlation <= VISIBLE / np.sqrt(count))
        visible = int(hidden[0]) if len(hidden) else len(correlation)
        if visible == 0:
            return 1.0, 0
        last = float(correlation[visible - 1])
        decay = min(last ** (1 / visible), LARGEST_DECAY)
        tau = 1 + 2 * (float(correlation[:visible].sum()) + last * decay / (1 - decay))
        tau = float(np.clip(tau, 1, max(1, count / FEWEST_EFFECTIVE)))
    return tau, visible


def _within(values: FloatArray, groups: list[npt.NDArray[np.intp]]) -> FloatArray:
    """The values less the mean of their sequence [N]."""
    off = values.copy()
    for group in groups:
        off[group] -= values[group].mean()
    return off


def _product(off: FloatArray, groups: list[npt.NDArray[np.intp]], lag: int) -> float:
    """The mean product of values that many clips apart in one sequence."""
    pairs = [(off[group[lag:]], off[group[:-lag]]) for group in groups if len(group) > lag]
    return sum(float(later @ earlier) for later, earlier in pairs) / sum(
        len(later) for later, _ in pairs
    )


def _groups(
    sequences: npt.NDArray[np.generic],
) -> tuple[list[npt.NDArray[np.intp]], npt.NDArray[np.intp]]:
    """The clips of each sequence, and those of sequences with fewer than SHORT clips together, as
    independent.
    """
    found = [np.flatnonzero(sequences == one) for one in np.unique(sequences)]
    short = [group for group in found if len(group) < SHORT]
    return [group for group in found if len(group) >= SHORT], np.sort(
        np.concatenate([np.arange(0), *short])
    )


def _resampled_sums(values: FloatArray, block: int, rng: np.random.Generator) -> FloatArray:
    """Sums [NUM_RESAMPLES] of as many values, drawn in blocks."""
    count = len(values)
    starts = rng.integers(0, count, (NUM_RESAMPLES, -(-count // block)))
    drawn = (starts[..., None] + np.arange(block)).reshape(NUM_RESAMPLES, -1)[:, :count] % count
    return np.asarray(values[drawn].sum(axis=1))
