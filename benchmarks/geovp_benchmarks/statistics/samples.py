"""Means and standard errors of scores: over steps within a clip first, then over clips.

A clip is one observation: its steps and samples depend on each other, so they never count as more.
"""

from collections.abc import Callable

import numpy as np

from geovp_benchmarks.results.scores import nanmean
from geovp_classic.types import FloatArray

# (values [N, S, F], higher_is_better) -> values of one sample per clip [N, F]
Reduction = Callable[[FloatArray, bool | None], FloatArray]


def mean_of_samples(values: FloatArray, higher_is_better: bool | None = None) -> FloatArray:
    """Return the mean over samples [N, F] of values [N, S, F]: the expected score of one sample."""
    return values[:, 0] if values.shape[1] == 1 else nanmean(values, axis=1)


def best_of_samples(values: FloatArray, higher_is_better: bool | None) -> FloatArray:
    """Return the values [N, F] of the sample that is best over all steps, per clip and metric.

    This is the selection of SRVP (Franceschi et al. 2020). If no direction is better: the mean.
    """
    if higher_is_better is None:
        return mean_of_samples(values)
    scores = nanmean(values, axis=2) * (1 if higher_is_better else -1)
    best = np.nan_to_num(scores, nan=-np.inf).argmax(axis=1)
    return values[np.arange(len(values)), best]


def reductions(num_samples: int) -> dict[str, Reduction]:
    """Return the mean and the best of samples, by the suffix of a method's name."""
    if num_samples == 1:
        return {"": mean_of_samples}
    return {
        f", mean of {num_samples}": mean_of_samples,
        f", best of {num_samples}": best_of_samples,
    }
