"""The scores of a method by column, from the means of its clips and samples."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.store import Contents, Method
from geovp_benchmarks.tables.table_model import MethodScores, Score
from geovp_classic.types import FloatArray


def method_scores(
    contents: Contents, method: Method, *, strict: bool = False, horizons: Sequence[int] = ()
) -> list[MethodScores]:
    """Return the scores of a method; of one with several samples, also those of the best sample.

    `strict` leaves out clips that the method could not predict. For each of the horizons there is a
    column of means over the first steps, such as "psnr t+5".
    """
    protocol, stored = contents.protocol, contents.scores[method.name]
    clips, means = protocol["clips"], stored.means()
    columns = dict(means)
    for num_steps in horizons:
        first = stored.means(num_steps)
        columns |= {f"{key} t+{num_steps}": values for key, values in first.items()}
    failed = np.isin(clips, [*contents.failures[method.name]]) & strict
    for values in columns.values():
        values[failed] = np.nan
    lines = []
    for suffix, reduce in _reductions(means, protocol).items():
        scores = {}
        for key, values in columns.items():
            facts = stored_facts.facts_of(key, protocol)
            by_clip = reduce(values[..., None], facts.get("higher_is_better"))[:, 0]
            if np.isfinite(by_clip).any():
                scores[key] = Score.of(by_clip, clips, stored_facts.bounds(facts))
        lines.append(
            MethodScores(
                method.label + suffix,
                scores,
                stored_facts.marks(method),
                method.num_clips - int(failed.sum()),
                reduce is not statistics.mean_of_samples,
                protocol["id"],
            )
        )
    return lines


def _reductions(
    means: Mapping[str, FloatArray], protocol: Mapping[str, Any]
) -> dict[str, statistics.Reduction]:
    """Return the reductions over samples, by the suffix of the method's name."""
    num_samples = max((values.shape[1] for values in means.values()), default=1)
    reductions = statistics.reductions(num_samples)
    for key, facts in protocol["metrics"].items():
        if num_samples > 1 and key in means and facts.get("higher_is_better") is not None:
            name = f", best of {num_samples} by {stored_facts.title(key)}"
            judge = means[key][..., None]
            return {**reductions, name: statistics.best_by(judge, facts["higher_is_better"])}
    return reductions
