"""Whether a row's confidence ranks its errors: Spearman correlations over stored
clips and steps.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geovp_benchmarks.results.score_names import CONFIDENCE
from geovp_benchmarks.results.store import Results
from geovp_classic.errors import BadData
from geovp_classic.registry import nearest
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Ranking:
    """Rank correlations with the metric (1: higher values have the better scores); NaN where not
    defined.
    """

    label: str
    num_clips: int
    by_confidence: float  # over all clips, samples and steps
    by_step: float  # of the step alone: what one knows without any confidence
    among_clips: float  # confidence, over clips and samples at one step, averaged over steps

    def texts(self) -> tuple[str, ...]:
        """Return the cells of a table."""
        numbers = (self.by_confidence, self.by_step, self.among_clips)
        return (
            self.label,
            str(self.num_clips),
            *(f"{one:.2f}" if np.isfinite(one) else "-" for one in numbers),
        )


def rankings(results: Results, metric: str) -> list[Ranking]:
    """Return a ranking for each row that has confidences; BadData for a metric that is not stored
    or has no better.
    """
    abouts = results.protocol()["metrics"]
    about = abouts.get(metric.partition("@")[0])
    known = [name for name, one in abouts.items() if one.get("higher_is_better") is not None]
    if about is None or about.get("higher_is_better") is None:
        raise BadData(f"{results.root} cannot be ranked by {metric!r}{nearest(metric, known)}")
    return list(_rankings(results, metric, 1.0 if about["higher_is_better"] else -1.0))


def _rankings(results: Results, metric: str, sign: float) -> Iterator[Ranking]:
    """Yield the ranking of each method that has confidences."""
    for method in results.methods():
        stored, failed = results.scores(method.name), results.failures(method.name)
        if not {CONFIDENCE, metric} <= stored.values.keys():
            continue
        known = np.array([clip not in failed for clip in stored.clips])
        confidence, score = stored.values[CONFIDENCE], sign * stored.values[metric]  # [N, S, F]
        known &= (np.isfinite(confidence) & np.isfinite(score)).any(axis=(1, 2))
        if known.any():
            confidence, score = confidence[known], score[known]
            earlier = np.broadcast_to(-np.arange(confidence.shape[2], dtype=float), score.shape)
            steps = range(confidence.shape[2] if len(confidence) >= 3 else 0)
            within = [spearman(confidence[..., step], score[..., step]) for step in steps]
            mean = float(np.mean([value for value in within if np.isfinite(value)] or [np.nan]))
            rank, by_step = spearman(confidence, score), spearman(earlier, score)
            yield Ranking(method.label, len(confidence), rank, by_step, mean)


def spearman(one: FloatArray, other: FloatArray) -> float:
    """Return Spearman's rank correlation over the values that both have; NaN where either
    does not vary.
    """
    both = np.isfinite(one) & np.isfinite(other)
    if both.sum() < 2 or np.ptp(one[both]) == 0 or np.ptp(other[both]) == 0:
        return float("nan")
    from scipy import stats  # half a second that no other table needs

    return float(stats.spearmanr(one[both], other[both]).statistic)
