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
sequences; what others would give cannot be told from a few.
`docs/concepts/statistics.md` lists how often such intervals hold the truth in simulations.
"""

import functools
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geovp_benchmarks.results.score_names import UNBOUNDED, Bounds
from geovp_benchmarks.statistics.score import Score, sequences_of
from geovp_benchmarks.statistics.student import student_p_value, student_quantile
from geovp_classic.types import FloatArray, IntArray


@dataclass(frozen=True)
class Groups:
    """Clips ordered by sequence; those of sequences with few clips form the last group."""

    order: IntArray  # [N], clips by group
    lengths: IntArray  # [G], clips of each group
    num_short: int = 0  # clips in the last group, which count as independent

    @classmethod
    def of(cls, sequences: IntArray, min_length: int) -> "Groups":
        """Return the groups of clips [N] by their sequences."""
        sizes = np.bincount(sequences)
        is_short = sizes[sequences] < min_length
        order = np.argsort(np.where(is_short, len(sizes), sequences), kind="stable")
        num_short = int(is_short.sum())
        lengths = [*sizes[sizes >= min_length], *[num_short] * (num_short > 0)]
        return cls(order, np.array(lengths, np.int64), num_short)

    def centred(self, ordered: FloatArray) -> FloatArray:
        """Return values [N] in the order of the groups less the mean of their group."""
        starts = np.cumsum(self.lengths) - self.lengths
        means = np.add.reduceat(ordered, starts) / self.lengths
        return ordered - np.repeat(means, self.lengths)

    def autocovariance(self, off: FloatArray, max_lag: int) -> FloatArray:
        """Return the mean products [L] of values 1 .. L clips apart in one group, by FFT."""
        gaps = np.repeat(np.arange(len(self.lengths)) * max_lag, self.lengths)
        size = 1 << (len(off) + len(self.lengths) * max_lag - 1).bit_length()
        padded = np.zeros(size)
        padded[np.arange(len(off)) + gaps] = off
        sums = np.fft.irfft(np.abs(np.fft.rfft(padded)) ** 2, size)[1 : max_lag + 1]
        lags = np.arange(1, max_lag + 1)
        num_pairs = np.maximum(np.subtract.outer(self.lengths, lags), 0).sum(axis=0)
        return np.asarray(sums / num_pairs)


@dataclass(frozen=True)
class BlockBootstrap:
    """Intervals by block bootstrap, widened to the cosine estimator's standard error."""

    level: float = 0.95
    seed: int = 0
    num_resamples: int = 2000
    max_resampled: int = 1000  # clips; the mean of more is taken as normally distributed
    min_visible: float = 1.5  # standard errors of a correlation that count
    max_correlation: float = 0.97
    max_decay: float = 0.95
    max_lag: int = 1000  # clips, unless sequences are few
    min_effective: float = 4.0  # clips
    max_lost: float = 0.5  # fraction of the variance that was taken out with the means
    slow_fraction: float = 0.15  # cosines per effective clip
    min_slow: float = 2.0
    min_error_ratio: float = 0.6  # of the standard error that independent values would have
    min_length: int = 3  # clips of a sequence

    def interval(
        self,
        values: FloatArray,  # [N]; NaN is left out
        clips: Sequence[str],  # [N], in the order in which they were taken
        bounds: Bounds = UNBOUNDED,
        *,
        has_ends: bool = True,
    ) -> Score:
        """Return the mean and its interval; without one for fewer than three values.

        It is cut at `bounds`, the lowest and highest value that there can be: the true mean lies
        between them, so that the interval holds it as often as before. A test needs the p-value
        alone: without `has_ends`, low and high are NaN.
        """
        is_finite = np.isfinite(values)
        finite, sequences = values[is_finite], sequences_of(tuple(clips))[is_finite]
        count = len(finite)
        if count == 0:
            return Score(math.nan, values=values)
        # Correlation of neighbours lowers the effective number of clips.
        groups = Groups.of(sequences, self.min_length)
        mean, ordered = float(finite.mean()), finite[groups.order]
        tau, visible = self.autocorrelation_time(ordered, groups)
        error = float(finite.std(ddof=1) / np.sqrt(count)) if count > 1 else math.nan
        # Error of the mean from slow changes, and the ends of the interval from resampled blocks.
        low = high = p_value = mean_error = degrees = math.nan
        if count > 2:
            mean_error, degrees = self.mean_error(ordered, groups, tau)
            if has_ends:
                offsets = self.offsets(ordered, groups, visible, mean_error, degrees)
                low, high = np.clip(mean + offsets, *bounds).tolist()
            p_value = student_p_value(mean, mean_error, degrees)
        return Score(
            mean,
            low,
            high,
            error,
            count,
            count / tau,
            values,
            p_value,
            mean_error=mean_error,
            degrees=degrees,
        )

    def mean_error(self, values: FloatArray, groups: Groups, tau: float) -> tuple[float, int]:
        """Return the standard error of the mean and its degrees of freedom."""
        deviation = float(values.std(ddof=1))
        if deviation <= 1e-12 * abs(values.mean()):
            return 0.0, 1
        error, degrees = self.standard_error(values, groups, tau)
        # few slow cosines can be small by chance
        return max(error, self.min_error_ratio * deviation / math.sqrt(len(values))), degrees

    def offsets(
        self, values: FloatArray, groups: Groups, visible: int, error: float, degrees: int
    ) -> FloatArray:
        """Return both ends of the interval less the mean [2], for values in the groups' order."""
        count, mean = len(values), values.mean()
        if not error:
            return np.zeros(2)
        tail = (1 + self.level) / 2
        normal = statistics.NormalDist().inv_cdf(tail)
        quantiles, spread = np.array([-normal, normal]), 1.0
        if count <= self.max_resampled:
            lengths = tuple(groups.lengths.tolist())
            draws = _draws(lengths, visible + 1, self.num_resamples, self.seed)
            off = np.einsum("rn,n->r", draws, values) / count - mean  # without threads, unlike @
            # np.quantile does the same in ten times the time
            places = (len(off) - 1) * np.array([1 - tail, tail])
            quantiles = np.interp(places, np.arange(len(off)), np.sort(off))
            spread = off.std()
        return np.asarray(student_quantile(degrees, tail) / normal * error / spread * quantiles)

    def autocorrelation_time(self, values: FloatArray, groups: Groups) -> tuple[float, int]:
        """Return tau, from 1 for independent values to N / min_effective, and the visible lags.

        The values [N] are in the order of the groups; correlation is visible at that many lags.
        """
        off, count, num_groups = groups.centred(values), len(values), len(groups.lengths)
        variance = float((off**2).mean())
        max_lag = min(int(groups.lengths.max()) // 3, max(self.max_lag, 2 * count // num_groups))
        if variance <= 1e-12 * float((values**2).mean()) or not max_lag:
            return 1.0, 0
        measured = groups.autocovariance(off, max_lag) / variance
        tau, visible = 1.0, 0
        for _ in range(4):  # the means that were taken out lower all of them
            lost = min(tau * num_groups / count, self.max_lost)
            correlation = np.minimum(measured + lost * (1 - measured), self.max_correlation)
            hidden = np.flatnonzero(correlation <= self.min_visible / np.sqrt(count))
            visible = int(hidden[0]) if len(hidden) else len(correlation)
            if visible == 0:
                return 1.0, 0
            last = float(correlation[visible - 1])
            decay = min(last ** (1 / visible), self.max_decay)
            tau = 1 + 2 * (float(correlation[:visible].sum()) + last * decay / (1 - decay))
            tau = float(np.clip(tau, 1, max(1, count / self.min_effective)))
        return tau, visible

    def standard_error(self, values: FloatArray, groups: Groups, tau: float) -> tuple[float, int]:
        """Return the standard error of the mean of dependent values, and its degrees of freedom.

        From the differences of the sequences' means and each sequence's slowest cosines; what a
        first-order autoregression of autocorrelation time `tau` has less of them than of the mean
        is added. The values [N] are in the order of the groups.
        """
        off, count, correlation = values - values.mean(), len(values), (tau - 1) / (tau + 1)
        num_long = count - groups.num_short
        long_lengths = groups.lengths[: len(groups.lengths) - (groups.num_short > 0)]
        powers = float((off[num_long:] ** 2).sum())
        expected, num = float(groups.num_short - 1), groups.num_short - 1
        num_slow = max(self.min_slow, self.slow_fraction * count / tau)
        for length in sorted(set(long_lengths.tolist())):  # sequences of one length at a time
            is_of_length = np.repeat(long_lengths == length, long_lengths)
            sequences = off[:num_long][is_of_length].reshape(-1, length)
            slow = min(round(num_slow * length / count), length - 1)
            angles_rad = np.pi * np.arange(slow + 1) / length
            ratios = (1 - correlation) ** 2
            ratios = ratios / (1 - 2 * correlation * np.cos(angles_rad) + correlation**2)
            mirrored = np.concatenate([sequences, sequences[:, ::-1]], axis=1)
            cosines = np.abs(np.fft.rfft(mirrored)[:, : slow + 1]) ** 2 / (2 * length)
            powers += float(cosines.sum() - cosines[:, 0].sum() / 2)  # orthonormal DCT-II, squared
            expected += len(sequences) * float(ratios.sum())
            num += len(sequences) * (slow + 1)
        return float(np.sqrt(powers / expected / count)), num


@functools.lru_cache(maxsize=16)
def _draws(lengths: tuple[int, ...], block: int, num_resamples: int, seed: int) -> FloatArray:
    """Return how often each resample draws each clip [R, N], in circular blocks of a group."""
    rng, columns = np.random.default_rng(seed), []
    rows = np.arange(num_resamples)[:, None]
    for length in lengths:
        size = min(block, length)
        starts = rng.integers(0, length, (num_resamples, -(-length // size)))
        drawn = (starts[..., None] + np.arange(size)).reshape(num_resamples, -1)[:, :length]
        counts = np.bincount((drawn % length + rows * length).ravel(), None, rows.size * length)
        columns.append(counts.reshape(num_resamples, length).astype(float))
    return np.concatenate(columns, axis=1)
