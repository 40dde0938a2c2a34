"""The scores of a method by column, from the means of its clips and samples."""

from collections.abc import Sequence

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.analysis.intervals import BlockBootstrap
from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.tables.table_model import MethodScores


def method_scores(
    results: Results, method: Method, *, strict: bool = False, horizons: Sequence[int] = ()
) -> list[MethodScores]:
    """Return the scores of a method; of one with several samples, also those of the best sample.

    `strict` leaves out clips that the method could not predict. For each of the horizons there is a
    column of means over the first steps, such as "psnr t+5".
    """
    protocol, stored = results.protocol(), results.scores(method.name)
    clips, columns = protocol["clips"], stored.means()
    for num_steps in horizons:
        first = stored.means(num_steps)
        columns |= {f"{key} t+{num_steps}": values for key, values in first.items()}
    failed = np.isin(clips, [*method.scored.failures]) & strict
    for values in columns.values():
        values[failed] = np.nan
    lines = []
    for suffix, reduce in statistics.reductions(method.num_samples).items():
        scores = {}
        for key, values in columns.items():
            facts = stored_facts.facts_of(key, protocol)
            by_clip = reduce(values[..., None], facts.get("higher_is_better"))[:, 0]
            if np.isfinite(by_clip).any():
                bounds = stored_facts.bounds(facts)
                scores[key] = BlockBootstrap().interval(by_clip, clips, bounds)
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
