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
    columns = {key: (key, values) for key, values in means.items()}
    for num_steps in horizons:
        first = stored.means(num_steps)
        columns |= {f"{key} t+{num_steps}": (key, values) for key, values in first.items()}
    failed = np.isin(clips, [*contents.failures[method.name]]) & strict
    for _, values in columns.values():
        values[failed] = np.nan
    lines = []
    for suffix, reduce in _reductions(means, protocol).items():
        scores = {}
        for name, (key, values) in columns.items():
            facts = stored_facts.facts_of(key, protocol)
            direction, bounds = facts.get("higher_is_better"), stored_facts.bounds(facts)
            reduced = {name: reduce(values[..., None], direction)[:, 0]}
            if reduce is statistics.best_of_samples and name == key and direction is not None:
                reduced |= _expected_best(values, key, direction)
            for column, by_clip in reduced.items():
                if np.isfinite(by_clip).any():
                    scores[column] = Score.of(by_clip, clips, bounds)
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


def _expected_best(means: FloatArray, key: str, direction: bool) -> dict[str, FloatArray]:
    """Return the expected best of k samples [N] by column, such as "psnr of 5"."""
    curve = statistics.expected_best(means[..., None], direction)
    num_samples = curve.shape[1]
    counts = sorted({1, 2, 5, 10, 20, 50, num_samples})
    return {f"{key} of {k}": curve[:, k - 1] for k in counts if k <= num_samples}


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
