"""Means and standard errors of stored rows: over steps within a clip first, then over clips.

A clip is one observation: its steps and samples depend on each other, so they never count as more.
"""

import functools
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geovp_benchmarks.results.rows import Rows
from geovp_classic.types import FloatArray

KIND = "± is one standard error of the mean over clips (sample standard deviation / sqrt(n))"


@dataclass(frozen=True)
class Cube:
    """All values of one metric in one method; NaN where a value is not defined."""

    clips: tuple[str, ...]
    values: FloatArray  # [N, S, F]


Reduction = Callable[
    [Cube, bool | None], FloatArray
]  # (cube, higher_is_better) -> one sample's values per clip [N, F]


@dataclass(frozen=True)
class Estimate:
    """Means over clips with their standard errors; scalars, or arrays over steps."""

    mean: FloatArray
    error: FloatArray  # NaN for fewer than two clips
    count: FloatArray  # clips that have a value


def cube(rows: Rows, metric: str) -> Cube:
    """Return the values of one metric from the rows of one method; clips in the order of the rows,
    steps 1..F.
    """
    rows = rows.of_metrics((metric,))
    values = np.full(rows.extent, np.nan)
    values[rows.clip.codes, rows.sample, rows.step - 1] = rows.value
    return Cube(rows.clip.categories, values)


def mean_of_samples(values: Cube, higher_is_better: bool | None) -> FloatArray:
    """Return the mean over samples [N, F]: the expected score of one sample."""
    return _nanmean(values.values, axis=1)


def best_of_samples(values: Cube, higher_is_better: bool | None) -> FloatArray:
    """Return the sample best over all steps, chosen per clip and metric [N, F], as SRVP does
    (Franceschi et al. 2020).

    Where no value is the better one, the mean.
    """
    if higher_is_better is None:
        return mean_of_samples(values, None)
    return values.values[np.arange(len(values.clips)), _best(values, higher_is_better)]


def best_by(judge: Cube, judge_higher_is_better: bool) -> Reduction:
    """Return the sample that is best in the judge's metric, for every metric: all columns show the
    same sample.
    """
    best = dict(zip(judge.clips, _best(judge, judge_higher_is_better).tolist(), strict=True))

    def reduce(values: Cube, higher_is_better: bool | None) -> FloatArray:
        nothing = np.full(values.values.shape[2], np.nan)
        rows = [
            values.values[number, best[clip]]
            if best.get(clip, np.inf) < values.values.shape[1]
            else nothing
            for number, clip in enumerate(values.clips)
        ]
        return np.stack(rows) if rows else np.empty((0, values.values.shape[2]))

    return reduce


def expected_best(values: Cube, higher_is_better: bool) -> FloatArray:
    """Return the expected best score of k samples [N, S], k = 1..S; NaN for more samples than have
    a value.

    Samples are scored by their mean over steps. The mean is over all sets of k among the S:
    unbiased for every k, and for k = S the best of all. Of scores sorted so that the best comes
    last, the i-th is the best of C(i - 1, k - 1) sets out of C(S, k).
    """
    scores = _nanmean(values.values, axis=2)
    curves = np.full(scores.shape, np.nan)
    for curve, row in zip(curves, scores, strict=True):
        known = np.sort(row[~np.isnan(row)])
        ordered = known if higher_is_better else known[::-1]
        curve[: len(ordered)] = _shares(len(ordered)) @ ordered
    return curves


def overall(values: FloatArray) -> Estimate:
    """Return the mean over steps within each clip, then over clips, from values [N, F]; scalars."""
    return over_clips(over_steps(values))


def over_steps(values: FloatArray) -> FloatArray:
    """Return the mean over steps [N] of values [N, F]; NaN where no step has one."""
    return _nanmean(values, axis=1)


def over_clips(values: FloatArray) -> Estimate:
    """Return the mean and standard error over the first axis, of values [N] or [N, F]; NaN is left
    out and not counted.
    """
    count = np.sum(~np.isnan(values), axis=0)
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
        error = np.nanstd(values, axis=0, ddof=1) / np.sqrt(count)
    return Estimate(_nanmean(values, axis=0), error, count)


def _best(values: Cube, higher_is_better: bool) -> npt.NDArray[np.intp]:
    """Return the best sample over all steps of each clip [N]; one without values is never it."""
    scores = _nanmean(values.values, axis=2) * (1.0 if higher_is_better else -1.0)
    if not scores.size:
        return np.zeros(len(scores), dtype=np.intp)
    return np.argmax(np.where(np.isnan(scores), -np.inf, scores), axis=1)


@functools.lru_cache(maxsize=8)
def _shares(count: int) -> FloatArray:
    """Return the share of the sets of k whose best is the i-th smallest [k, i]; rows sum to 1."""
    numbers = range(1, count + 1)
    return np.array(
        [[math.comb(i - 1, k - 1) / math.comb(count, k) for i in numbers] for k in numbers]
    ).reshape(count, count)


def _nanmean(values: FloatArray, axis: int) -> FloatArray:
    """Return np.nanmean that answers NaN for an empty slice without a warning."""
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
        return np.asarray(np.nanmean(values, axis=axis))
