"""Spearman correlations of confidence with scores, over stored clips and steps."""

import numpy as np

from geovp_benchmarks.results.score_names import CONFIDENCE
from geovp_benchmarks.results.scores import nanmean
from geovp_benchmarks.results.store import Results
from geovp_classic.types import FloatArray

Ranking = tuple[str, int, float, float, float]


def rankings(results: Results, metric: str) -> list[Ranking]:
    """Return rank correlations with a metric: 1 if higher values have better scores.

    For each method that has confidences: its label, the number of clips, and the correlations of
    confidence over all clips, samples and steps, of the step alone, which is known without any
    confidence, and of confidence at a single step, averaged over steps; NaN if undefined.
    """
    sign = 1.0 if results.protocol()["metrics"][metric]["higher_is_better"] else -1.0
    ranked = []
    for method in results.methods():
        stored = results.scores(method.name)
        if {CONFIDENCE, metric} <= stored.values.keys():
            confidence, score = stored.values[CONFIDENCE], sign * stored.values[metric]  # [N, S, F]
            is_used = np.isfinite(confidence * score).any(axis=(1, 2))
            is_used &= ~np.isin(stored.clips, [*results.failures(method.name)])
            confidence, score = confidence[is_used], score[is_used]
            steps = np.arange(score.shape[2])
            earlier = np.broadcast_to(-steps.astype(float), score.shape)
            within = [spearman(confidence[..., step], score[..., step]) for step in steps]
            among_clips = float(nanmean(np.array(within), axis=0))
            correlations = spearman(confidence, score), spearman(earlier, score), among_clips
            ranked.append((method.label, len(score), *correlations))
    return ranked


def spearman(a: FloatArray, b: FloatArray) -> float:
    """Return Spearman's rank correlation of finite values; NaN if either is constant."""
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 3 or np.ptp(a[both]) == 0 or np.ptp(b[both]) == 0:
        return float("nan")
    from scipy import stats  # half a second that no other table needs

    return float(stats.spearmanr(a[both], b[both]).statistic)
