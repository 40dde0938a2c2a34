"""Intervals of means and tests of paired differences: one rule for tables, marks and reports.

With eight or more drives, each drive is one observation: Student's t over the means of the drives
(Ibragimov & Mueller 2010), which holds for other drives of this kind, too. With fewer, a block
bootstrap over the clips, which holds for these drives alone. Differences are tested where there are
at least eight effective drives or clips, and Holm's procedure (1979) controls the probability of a
false mark among all methods that are compared.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geovp_benchmarks.results.score_names import UNBOUNDED, Bounds
from geovp_benchmarks.results.scores import nanmean
from geovp_benchmarks.statistics.bootstrap import BlockBootstrap
from geovp_benchmarks.statistics.score import Score, sequences_of
from geovp_benchmarks.statistics.student import student_p_value, student_quantile
from geovp_classic.types import FloatArray, IntArray


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
    ) -> Score:
        """Return the mean over clips with its interval and the p-value of a mean of zero."""
        return self.intervals(values[None], clips, [bounds])[0]

    def intervals(
        self,
        values: FloatArray,  # [K, N], of several scores
        clips: Sequence[str],
        bounds: Sequence[Bounds],  # [K]
        *,
        has_ends: bool = True,
    ) -> list[Score]:
        """Return the mean of each row as `interval` does."""
        is_finite = np.isfinite(values)
        rows_of: dict[bytes, list[int]] = {}  # by the clips that have a value
        for number, row in enumerate(is_finite):
            rows_of.setdefault(row.tobytes(), []).append(number)
        scores: dict[int, Score] = {}
        for rows in rows_of.values():
            of_clips, of_rows = is_finite[rows[0]], [bounds[number] for number in rows]
            drives = sequences_of(tuple(clips))[of_clips]
            if np.count_nonzero(np.bincount(drives)) < self.min_drives:
                means = self.bootstrap.intervals(
                    values[rows], of_clips, clips, of_rows, has_ends=has_ends
                )
            else:
                means = [
                    self._over_drives(values[number], drives, bounds[number]) for number in rows
                ]
            scores |= zip(rows, means, strict=True)
        return [scores[number] for number in range(len(values))]

    def _over_drives(self, values: FloatArray, drives: IntArray, bounds: Bounds) -> Score:
        """Return the interval of values by the drive of each that is finite."""
        finite = values[np.isfinite(values)]
        counts, sums = np.bincount(drives), np.bincount(drives, finite)
        means, weights = sums[counts > 0] / counts[counts > 0], counts[counts > 0] / len(finite)
        mean = float(finite.mean())  # of the drives' means by their lengths
        squares = float((weights**2).sum())
        variance = (weights**2 * (means - mean) ** 2).sum() / (1 - squares)
        score = Score(
            mean,
            standard_error=float(finite.std(ddof=1)) / math.sqrt(len(finite)),
            clips=len(finite),
            effective_clips=float(len(means)),
            values=values,
            is_over_drives=True,
        )
        # Kish's effective number is that of drives for equally long ones
        return self._by_student(score, math.sqrt(variance), 1 / squares - 1, bounds)

    def _by_student(self, score: Score, error: float, degrees: float, bounds: Bounds) -> Score:
        """Return a score with Student's interval and test for this error of its mean."""
        half = student_quantile(degrees, (1 + self.level) / 2) * error
        low, high = np.clip([score.mean - half, score.mean + half], *bounds).tolist()
        p_value = student_p_value(score.mean, error, degrees)
        return replace(
            score, low=low, high=high, p_value=p_value, mean_error=error, degrees=degrees
        )

    def over_seeds(
        self,
        seeds: FloatArray,  # [R, N] of training seeds and clips
        clips: Sequence[str],
        bounds: Bounds = UNBOUNDED,
    ) -> Score:
        """Return the mean over seeds and clips; other seeds would differ, too."""
        score = self.interval(nanmean(seeds, axis=0), clips, bounds)
        return replace(self.widened(score, bounds, nanmean(seeds, axis=1)), seeds=seeds)

    def differences(
        self,
        pairs: Sequence[tuple[Score, Score]],
        clips: Sequence[str],
        bounds: Bounds = UNBOUNDED,
        *,
        has_ends: bool = True,
    ) -> list[Score]:
        """Return paired differences of methods from others, all of which may have training seeds.

        Without `has_ends` they have p-values, but no interval.
        """
        if not pairs:
            return []
        values = np.array([score.values - reference.values for score, reference in pairs])
        gaps = self.intervals(values, clips, [bounds] * len(pairs), has_ends=has_ends)
        differences = []
        for (score, reference), gap in zip(pairs, gaps, strict=True):
            sides = ((score.seeds, reference.values), (reference.seeds, score.values))
            means = [nanmean(seeds - other, axis=1) for seeds, other in sides if len(seeds)]
            differences.append(self.widened(gap, bounds, *means))
        return differences

    def widened(self, score: Score, bounds: Bounds, *means_of_seeds: FloatArray) -> Score:
        """Return a score whose error includes the variance among training seeds.

        The variances of the means over drives or clips and over seeds add up, and the degrees of
        freedom are those of Welch (1947) and Satterthwaite (1946).
        """
        parts = [(score.mean_error**2, score.degrees)]
        parts += [(means.var(ddof=1) / len(means), len(means) - 1) for means in means_of_seeds]
        variance = sum(part for part, _ in parts)
        if not means_of_seeds or not variance > 0:
            return score
        degrees = variance**2 / sum(part**2 / freedom for part, freedom in parts)
        return self._by_student(score, math.sqrt(variance), degrees, bounds)


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
