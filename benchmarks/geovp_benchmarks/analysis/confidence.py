"""Spearman correlations of confidence with scores, over stored clips and steps."""

from dataclasses import dataclass

import numpy as np

from geovp_benchmarks.results.score_names import CONFIDENCE
from geovp_benchmarks.results.store import Contents
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Ranking:
    """Rank correlations with a metric: 1 if higher values have better scores; NaN: not defined."""

    label: str
    num_clips: int
    by_confidence: float  # over all clips, samples and steps
    by_step: float  # of the step alone: what one knows without any confidence
    among_clips: float  # confidence, over clips and samples at one step, averaged over steps

    def texts(self) -> tuple[str, ...]:
        """Return the cells of a table."""
        numbers = (self.by_confidence, self.by_step, self.among_clips)
        texts = (f"{number:.2f}" if np.isfinite(number) else "-" for number in numbers)
        return (self.label, str(self.num_clips), *texts)


def rankings(contents: Contents, metric: str) -> list[Ranking]:
    """Return a ranking by a metric that has a direction for each method that has confidences."""
    sign = 1.0 if contents.protocol["metrics"][metric]["higher_is_better"] else -1.0
    ranked = []
    for method in contents.methods:
        stored, failed = contents.scores[method.name], contents.failures[method.name]
        if not {CONFIDENCE, metric} <= stored.values.keys():
            continue
        confidence, score = stored.values[CONFIDENCE], sign * stored.values[metric]  # [N, S, F]
        is_used = np.array([clip not in failed for clip in stored.clips])
        is_used &= (np.isfinite(confidence) & np.isfinite(score)).any(axis=(1, 2))
        if is_used.any():
            ranked.append(_ranking(method.label, confidence[is_used], score[is_used]))
    return ranked


def _ranking(label: str, confidence: FloatArray, score: FloatArray) -> Ranking:
    """Return the ranking of confidences and scores [N, S, F]."""
    count, _, num_steps = confidence.shape
    earlier = np.broadcast_to(-np.arange(num_steps, dtype=float), score.shape)
    steps = range(num_steps if count >= 3 else 0)
    within = [spearman(confidence[..., step], score[..., step]) for step in steps]
    among_clips = float(np.mean([value for value in within if np.isfinite(value)] or [np.nan]))
    by_confidence, by_step = spearman(confidence, score), spearman(earlier, score)
    return Ranking(label, count, by_confidence, by_step, among_clips)


def spearman(a: FloatArray, b: FloatArray) -> float:
    """Return Spearman's rank correlation of finite values; NaN if either is constant."""
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 2 or np.ptp(a[both]) == 0 or np.ptp(b[both]) == 0:
        return float("nan")
    from scipy import stats  # half a second that no other table needs

    return float(stats.spearmanr(a[both], b[both]).statistic)
