"""Means and standard errors of stored rows: over steps within a clip first, then over clips.

A clip is one observation: its steps and samples depend on each other, so they never count as more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from geovp_classic.types import FloatArray

KIND = "± is one standard error of the mean over clips (sample standard deviation / sqrt(n))"


@dataclass(frozen=True)
class Cube:
    """All values of one metric in one cell; NaN where a value is not defined."""

    clips: tuple[str, ...]
    values: FloatArray  # [N, S, F]


Reduction = Callable[[Cube, bool], FloatArray]  # (cube, higher_is_better) -> one sample's values per clip [N, F]


@dataclass(frozen=True)
class Estimate:
    """Means over clips with their standard errors; scalars, or arrays over steps."""

    mean: FloatArray
    error: FloatArray  # NaN for fewer than two clips
    count: FloatArray  # clips that have a value


def cube(rows: pa.Table, metric: str) -> Cube:
    """The values of one metric from the rows of one cell; clips in the order of the rows, steps 1..F."""
    rows = rows.filter(pc.equal(rows["metric"], metric))
    clips = pc.unique(rows["clip"]).to_pylist()
    which = pc.index_in(rows["clip"], value_set=pa.array(clips, pa.string())).to_numpy()
    sample, step = rows["sample"].to_numpy(), rows["step"].to_numpy() - 1
    shape = (len(clips), sample.max(initial=-1) + 1, step.max(initial=-1) + 1)
    values = np.full(shape, np.nan)
    values[which, sample, step] = rows["value"].to_numpy()
    return Cube(tuple(clips), values)


def mean_of_samples(values: Cube, higher_is_better: bool) -> FloatArray:
    """The average sample [N, F]: what one guess is worth."""
    return _nanmean(values.values, axis=1)


def best_of_samples(values: Cube, higher_is_better: bool) -> FloatArray:
    """The sample best over all steps, chosen per clip and metric [N, F], as SRVP does (Franceschi et al. 2020)."""
    scores = _nanmean(values.values, axis=2) * (1.0 if higher_is_better else -1.0)
    best = np.argmax(np.where(np.isnan(scores), -np.inf, scores), axis=1)
    return values.values[np.arange(len(best)), best]


def per_step(values: FloatArray) -> Estimate:
    """The mean over clips at each step, from values [N, F]; arrays [F]."""
    return over_clips(values)


def overall(values: FloatArray) -> Estimate:
    """The mean over steps within each clip, then over clips, from values [N, F]; scalars."""
    return over_clips(_nanmean(values, axis=1))


def over_clips(values: FloatArray) -> Estimate:
    """Mean and standard error over the first axis; clips without a value are left out and not counted."""
    known = ~np.isnan(values)
    count = known.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = _nanmean(values, axis=0)
        spread = np.sqrt(np.where(known, (values - mean) ** 2, 0.0).sum(axis=0) / np.maximum(count - 1, 1))
        error = np.where(count > 1, spread / np.sqrt(np.maximum(count, 1)), np.nan)
    return Estimate(mean, error, count)


def _nanmean(values: FloatArray, axis: int) -> FloatArray:
    """np.nanmean that answers NaN for an empty slice without a warning."""
    known = ~np.isnan(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    mean: FloatArray = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return mean
