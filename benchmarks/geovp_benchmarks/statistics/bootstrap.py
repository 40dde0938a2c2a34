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

from geovp_benchmarks.results.score_names import Bounds
from geovp_benchmarks.statistics.score import Score, sequences_of
from geovp_benchmarks.statistics.student import student_p_value, student_quantile
from geovp_classic.types import BoolArray, FloatArray, IntArray


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
        lengths = sizes[sizes >= min_length]
        if num_short:
            lengths = np.append(lengths, num_short)
        return cls(order, lengths, num_short)

    def centred(self, ordered: FloatArray) -> FloatArray:
        """Return values [K, N] in the order of the groups less the mean of their group."""
        starts = np.cumsum(self.lengths) - self.lengths
        means = np.add.reduceat(ordered, starts, axis=1) / self.lengths
        return ordered - np.repeat(means, self.lengths, axis=1)

    def autocovariance(self, off: FloatArray, max_lag: int) -> FloatArray:
        """Return the mean products [K, L] of values 1 .. L clips apart in one group, by FFT."""
        num_rows, count = off.shape
        gaps = np.repeat(np.arange(len(self.lengths)) * max_lag, self.lengths)
        size = 1 << (count + len(self.lengths) * max_lag - 1).bit_length()
        padded = np.zeros((num_rows, size))
        padded[:, np.arange(count) + gaps] = off
        sums = np.fft.irfft(np.abs(np.fft.rfft(padded)) ** 2, size)[:, 1 : max_lag + 1]
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

    def intervals(
        self,
        values: FloatArray,  # [K, N]: several scores at once take little more time
        is_finite: BoolArray,  # [N], the same for all of them
        clips: Sequence[str],  # [N], in the order in which they were taken
        bounds: Sequence[Bounds],  # [K]
        *,
        has_ends: bool = True,
    ) -> list[Score]:
        """Return means and their intervals; without those for fewer than three values.

        They are cut at `bounds`, the lowest and highest value that there can be: the true mean lies
        between them, so that the interval holds it as often as before. A test needs the p-value
        alone: without `has_ends`, low and high are NaN.
        """
        sequences = sequences_of(tuple(clips))[is_finite]
        count = len(sequences)
        if count == 0:
            return [Score(math.nan, values=row) for row in values]
        # Correlation of neighbours lowers the effective number of clips.
        groups = Groups.of(sequences, self.min_length)
        ordered = values[:, is_finite][:, groups.order]
        means = ordered.mean(axis=1)
        tau, visible = self.autocorrelation_time(ordered, groups)
        # Error of the mean from slow changes, and the ends of the interval from resampled blocks.
        errors = mean_errors = np.full(len(values), math.nan)
        degrees: FloatArray | IntArray = errors
        ends = np.full((len(values), 2), math.nan)
        if count > 1:
            errors = ordered.std(axis=1, ddof=1) / np.sqrt(count)
        if count > 2:
            mean_errors, degrees = self.mean_error(ordered, groups, tau)
            if has_ends:
                offsets = self.offsets(ordered, groups, visible, mean_errors, degrees)
                ends = np.clip((means[:, None] + offsets).T, *np.transpose(bounds)).T
        return [
            Score(
                mean,
                low,
                high,
                error,
                count,
                count / tau_of_row,
                row,
                student_p_value(mean, mean_error, freedom) if count > 2 else math.nan,
                mean_error=mean_error,
                degrees=freedom,
            )
            for row, mean, (low, high), error, tau_of_row, mean_error, freedom in zip(
                values,
                means.tolist(),
                ends.tolist(),
                errors.tolist(),
                tau.tolist(),
                mean_errors.tolist(),
                degrees.tolist(),
                strict=True,
            )
        ]

    def mean_error(
        self, values: FloatArray, groups: Groups, tau: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Return the standard errors of the means [K] and their degrees of freedom."""
        deviations = values.std(axis=1, ddof=1)
        errors, degrees = self.standard_error(values, groups, tau)
        # few slow cosines can be small by chance
        min_errors = self.min_error_ratio * deviations / math.sqrt(values.shape[1])
        is_constant = deviations <= 1e-12 * np.abs(values.mean(axis=1))
        errors = np.where(is_constant, 0.0, np.maximum(errors, min_errors))
        return errors, np.where(is_constant, 1, degrees)

    def offsets(
        self,
        values: FloatArray,
        groups: Groups,
        visible: IntArray,
        errors: FloatArray,
        degrees: IntArray,
    ) -> FloatArray:
        """Return both ends of the intervals less the means [K, 2], for values [K, N] in the groups'
        order.
        """
        num_rows, count = values.shape
        tail = (1 + self.level) / 2
        normal = statistics.NormalDist().inv_cdf(tail)
        quantiles = np.tile([-normal, normal], (num_rows, 1))
        spread = np.ones(num_rows)
        for lags in set(visible.tolist()) if count <= self.max_resampled else ():
            rows = visible == lags
            draws = _draws(tuple(groups.lengths.tolist()), lags + 1, self.num_resamples, self.seed)
            means = np.einsum("rn,kn->kr", draws, values[rows]) / count  # no threads, unlike @
            off = means - values[rows].mean(axis=1, keepdims=True)
            # np.quantile does the same, but loads numpy.ma: a tenth of the time of a table
            places = (self.num_resamples - 1) * np.array([1 - tail, tail])
            below = places.astype(int)
            ordered = np.partition(off, [*below, *(below + 1)], axis=1)
            rest = ordered[:, below + 1] - ordered[:, below]
            quantiles[rows] = ordered[:, below] + (places - below) * rest
            spread[rows] = off.std(axis=1)
        students = np.array([student_quantile(freedom, tail) for freedom in degrees.tolist()])
        # constant values have neither an error nor a spread
        scale = students / normal * errors / np.where(errors > 0, spread, 1.0)
        return np.asarray(scale[:, None] * quantiles)

    def autocorrelation_time(
        self, values: FloatArray, groups: Groups
    ) -> tuple[FloatArray, IntArray]:
        """Return tau, from 1 for independent values to N / min_effective, and the visible lags.

        The values [K, N] are in the order of the groups; correlation is visible at that many lags.
        """
        num_rows, count = values.shape
        num_groups = len(groups.lengths)
        off = groups.centred(values)
        variance = (off**2).mean(axis=1)
        max_lag = min(int(groups.lengths.max()) // 3, max(self.max_lag, 2 * count // num_groups))
        is_constant = variance <= 1e-12 * (values**2).mean(axis=1)
        tau, visible = np.ones(num_rows), np.zeros(num_rows, np.int64)
        if not max_lag:
            return tau, visible
        divisor = np.where(is_constant, np.inf, variance)  # constant values are not correlated
        measured = groups.autocovariance(off, max_lag) / divisor[:, None]
        lags = np.arange(1, max_lag + 1)
        for _ in range(4):  # the means that were taken out lower all of them
            lost = np.minimum(tau * num_groups / count, self.max_lost)[:, None]
            correlation = np.minimum(measured + lost * (1 - measured), self.max_correlation)
            is_hidden = correlation <= self.min_visible / np.sqrt(count)
            first_hidden = np.where(is_hidden.any(axis=1), is_hidden.argmax(axis=1), max_lag)
            visible = np.where(is_constant, 0, first_hidden)
            is_visible = lags <= visible[:, None]
            last = np.where(lags == visible[:, None], correlation, 0.0).sum(axis=1)
            decay = np.minimum(last ** (1 / np.maximum(visible, 1)), self.max_decay)
            tail = last * decay / (1 - decay)  # goes on geometrically
            tau = 1 + 2 * (np.where(is_visible, correlation, 0.0).sum(axis=1) + tail)
            tau = np.clip(tau, 1, max(1, count / self.min_effective))
        return tau, visible

    def standard_error(
        self, values: FloatArray, groups: Groups, tau: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Return the standard errors of means of dependent values, and their degrees of freedom.

        From the differences of the sequences' means and each sequence's slowest cosines; what a
        first-order autoregression of autocorrelation time `tau` has less of them than of the mean
        is added. The values [K, N] are in the order of the groups.
        """
        num_rows, count = values.shape
        off = values - values.mean(axis=1, keepdims=True)
        correlation = ((tau - 1) / (tau + 1))[:, None]
        num_long = count - groups.num_short
        long_lengths = groups.lengths[: len(groups.lengths) - (groups.num_short > 0)]
        powers = (off[:, num_long:] ** 2).sum(axis=1)
        expected = np.full(num_rows, groups.num_short - 1.0)
        num = np.full(num_rows, groups.num_short - 1)
        num_slow = np.maximum(self.min_slow, self.slow_fraction * count / tau)
        for length in sorted(set(long_lengths.tolist())):  # sequences of one length at a time
            is_of_length = np.repeat(long_lengths == length, long_lengths)
            sequences = off[:, :num_long][:, is_of_length].reshape(num_rows, -1, length)
            slow = np.minimum(np.round(num_slow * length / count).astype(int), length - 1)
            orders = np.arange(int(slow.max()) + 1)  # of the cosines
            is_slow = orders <= slow[:, None]
            ratios = 1 - 2 * correlation * np.cos(np.pi * orders / length) + correlation**2
            ratios = np.where(is_slow, (1 - correlation) ** 2 / ratios, 0.0)
            mirrored = np.concatenate([sequences, sequences[..., ::-1]], axis=2)
            cosines = np.abs(np.fft.rfft(mirrored)[..., : len(orders)]) ** 2 / (2 * length)
            cosines[..., 0] /= 2  # orthonormal DCT-II, squared
            powers += np.where(is_slow, cosines.sum(axis=1), 0.0).sum(axis=1)
            expected += sequences.shape[1] * ratios.sum(axis=1)
            num += sequences.shape[1] * (slow + 1)
        return np.sqrt(powers / expected / count), num


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
