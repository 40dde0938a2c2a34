"""Means and standard errors of scores: over steps within a clip first, then over clips.

A clip is one observation: its steps and samples depend on each other, so they never count as more.
"""

import functools
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geovp_benchmarks.results.scores import nanmean
from geovp_classic.types import FloatArray

# (values [N, S, F], higher_is_better) -> values of one sample per clip [N, F]
Reduction = Callable[[FloatArray, bool | None], FloatArray]


@dataclass(frozen=True)
class Estimate:
    """Means over clips with their standard errors; scalars, or arrays over steps."""

    mean: FloatArray
    error: FloatArray  # NaN for fewer than two clips
    count: FloatArray  # clips that have a value


def mean_of_samples(values: FloatArray, higher_is_better: bool | None = None) -> FloatArray:
    """Return the mean over samples [N, F] of values [N, S, F]: the expected score of one sample."""
    return nanmean(values, axis=1)


def best_of_samples(values: FloatArray, higher_is_better: bool | None) -> FloatArray:
    """Return the values [N, F] of the sample that is best over all steps, per clip and metric.

    This is the selection of SRVP (Franceschi et al. 2020). If no direction is better: the mean.
    """
    if higher_is_better is None:
        return mean_of_samples(values)
    return best_by(values, higher_is_better)(values, higher_is_better)


def reductions(num_samples: int) -> dict[str, Reduction]:
    """Return the mean and the best of samples, by the suffix of a method's name."""
    if num_samples == 1:
        return {"": mean_of_samples}
    return {
        f", mean of {num_samples}": mean_of_samples,
        f", best of {num_samples}": best_of_samples,
    }


def best_by(judge: FloatArray, judge_higher_is_better: bool) -> Reduction:
    """Return the reduction to the sample that is best in the judge's values, for every metric."""
    sign = 1.0 if judge_higher_is_better else -1.0
    scores = np.nan_to_num(sign * nanmean(judge, axis=2), nan=-np.inf)
    best = scores.argmax(axis=1)
    is_known = scores.max(axis=1) > -np.inf

    def reduce(values: FloatArray, higher_is_better: bool | None) -> FloatArray:
        is_defined = is_known & (best < values.shape[1])
        selected = values[np.arange(len(values)), np.where(is_defined, best, 0)]
        return np.where(is_defined[:, None], selected, np.nan)

    return reduce


def expected_best(values: FloatArray, higher_is_better: bool) -> FloatArray:
    """Return the expected best score of k samples [N, S], k = 1..S, of values [N, S, F].

    Samples are scored by their mean over steps; NaN for more samples than have a value. The mean
    is over all sets of k among the S: unbiased for every k, and for k = S the best of all. Of
    scores sorted so that the best comes last, the i-th is the best of C(i - 1, k - 1) sets out of
    C(S, k).
    """
    scores = nanmean(values, axis=2)
    curves = np.full(scores.shape, np.nan)
    for curve, row in zip(curves, scores, strict=True):
        ascending = np.sort(row[~np.isnan(row)])
        ordered = ascending if higher_is_better else ascending[::-1]
        curve[: len(ordered)] = _fractions(len(ordered)) @ ordered
    return curves


def over_steps(values: FloatArray) -> FloatArray:
    """Return the mean over steps [N] of values [N, F]; NaN where no step has one."""
    return nanmean(values, axis=1)


def over_clips(values: FloatArray) -> Estimate:
    """Return the mean and standard error over the first axis, of values [N] or [N, F].

    NaN is left out and not counted.
    """
    count = np.sum(~np.isnan(values), axis=0)
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
        error = np.nanstd(values, axis=0, ddof=1) / np.sqrt(count)
    return Estimate(nanmean(values, axis=0), error, count)


@functools.lru_cache(maxsize=8)
def _fractions(count: int) -> FloatArray:
    """Return the fraction of the sets of k whose best is the i-th smallest [k, i]."""
    numbers = range(1, count + 1)
    rows = [[math.comb(i - 1, k - 1) / math.comb(count, k) for i in numbers] for k in numbers]
    return np.array(rows).reshape(count, count)
