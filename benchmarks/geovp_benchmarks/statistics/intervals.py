"""Intervals of means and tests of paired differences: one rule for tables, marks and reports.

With eight or more drives, each drive is one observation: Student's t over the means of the drives
(Ibragimov & Mueller 2010), which holds for other drives of this kind, too. With fewer, a block
bootstrap over the clips, which holds for these drives alone. Differences are tested where there are
at least eight effective drives or clips, and Holm's procedure (1979) controls the probability of a
false mark among all methods that are compared.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geovp_benchmarks.results.score_names import UNBOUNDED, Bounds
from geovp_benchmarks.statistics.bootstrap import BlockBootstrap
from geovp_benchmarks.statistics.score import Score, sequences_of
from geovp_benchmarks.statistics.student import student_p_value, student_quantile
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Intervals:
    """Intervals of means over clips."""

    level: float = 0.95
    min_drives: int = 8  # for an interval over drives
    bootstrap: BlockBootstrap = BlockBootstrap()  # with fewer

    def interval(
        self,
        values: FloatArray,  # [N]; NaN is left out
        clips: Sequence[str],  # [N], in the order in which they were taken
        bounds: Bounds = UNBOUNDED,
        *,
        has_ends: bool = True,  # else the p-value alone, which takes half the time
    ) -> Score:
        """Return the mean over clips with its interval and the p-value of a mean of zero."""
        is_finite = np.isfinite(values)
        finite, drives = values[is_finite], sequences_of(tuple(clips))[is_finite]
        counts, sums = np.bincount(drives), np.bincount(drives, finite)
        num_drives = np.count_nonzero(counts)
        if num_drives < self.min_drives:
            return self.bootstrap.interval(values, clips, bounds, has_ends=has_ends)
        means, weights = sums[counts > 0] / counts[counts > 0], counts[counts > 0] / len(finite)
        mean = float(finite.mean())  # of the drives' means by their lengths
        squares = float((weights**2).sum())
        variance = (weights**2 * (means - mean) ** 2).sum() / (1 - squares)
        # Kish's effective number is that of drives for equally long ones
        error, degrees = math.sqrt(variance), 1 / squares - 1
        half = student_quantile(degrees, (1 + self.level) / 2) * error
        low, high = np.clip([mean - half, mean + half], *bounds).tolist()
        return Score(
            mean,
            low,
            high,
            float(finite.std(ddof=1)) / math.sqrt(len(finite)),
            len(finite),
            float(num_drives),
            values,
            student_p_value(mean, error, degrees),
            is_over_drives=True,
        )


def holm(scores: Sequence[Score], level: float = 0.05) -> list[bool]:
    """Return which means differ significantly from zero, by Holm's step-down procedure.

    Those of too few effective clips are not tested; they still count among the compared.
    """
    order = sorted(range(len(scores)), key=lambda number: scores[number].p_value)
    is_significant = [False] * len(scores)
    for rank, number in enumerate(order):
        if not scores[number].p_value <= level / (len(scores) - rank):  # NaN is not significant
            break
        is_significant[number] = not scores[number].has_few_clips
    return is_significant
