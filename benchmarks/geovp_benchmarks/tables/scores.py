"""The scores of a method by column, from the values of its clips, samples and steps."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.analysis.statistics import Cube
from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.provenance import method_id
from geovp_benchmarks.results.store import Method, Results, Rows
from geovp_benchmarks.tables.table_model import MethodScores, Score
from geovp_classic.types import FloatArray


def method_scores(
    results: Results, method: Method, *, strict: bool = False, horizons: Sequence[int] = ()
) -> list[MethodScores]:
    """Return the scores of a method; of one with several samples, also those of the best sample.

    `strict` leaves out clips that the method could not predict. For each of the horizons there is a
    column of means over the first steps, such as "psnr t+5".
    """
    protocol, rows = results.protocol(), results.scores(method.name)
    if strict:
        rows = rows.of_clips({*rows.clip.categories} - results.failures(method.name).keys())
    cubes = {key: cube(rows, key, protocol["clips"]) for key in rows.metric.categories}
    lines = []
    for suffix, reduce in _reductions(cubes, protocol).items():
        scores = {}
        for key, values in cubes.items():
            facts = facts_of(key, protocol)
            direction = stored_facts.higher_is_better(key, facts)
            steps = reduce(values, direction)
            columns = {key: steps, **{f"{key} t+{k}": steps[:, :k] for k in horizons}}
            if reduce is statistics.best_of_samples and direction is not None:
                columns |= _expected_best(values, key, direction)
            for name, steps in columns.items():
                means = statistics.over_steps(steps)
                if np.isfinite(means).any():
                    bounds = stored_facts.bounds(key, facts)
                    scores[name] = Score.of(means, protocol["clips"], bounds)
        lines.append(
            MethodScores(
                method.label + suffix,
                scores,
                stored_facts.marks(method),
                len(rows.clip.categories),
                reduce is not statistics.mean_of_samples,
                method_id(method, protocol),
            )
        )
    return lines


def facts_of(key: str, protocol: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what the protocol says about the metric of a column."""
    facts: Mapping[str, Any] = protocol["metrics"].get(key.split("@")[0].split(" ")[0], {})
    return facts


def cube(rows: Rows, key: str, clips: Sequence[str]) -> Cube:
    """Return the values of a metric for all clips; NaN where there are none."""
    stored = statistics.cube(rows, key)
    places = {clip: place for place, clip in enumerate(clips)}
    values = np.full((len(clips), *stored.values.shape[1:]), np.nan)
    values[[places[clip] for clip in stored.clips]] = stored.values
    return Cube(tuple(clips), values)


def _expected_best(values: Cube, key: str, direction: bool) -> dict[str, FloatArray]:
    """Return the expected best of k samples [N, 1] by column, such as "psnr of 5"."""
    curve = statistics.expected_best(values, direction)
    num_samples = curve.shape[1]
    counts = sorted({1, 2, 5, 10, 20, 50, num_samples})
    return {f"{key} of {k}": curve[:, k - 1 : k] for k in counts if k <= num_samples}


def _reductions(
    cubes: Mapping[str, Cube], protocol: Mapping[str, Any]
) -> dict[str, statistics.Reduction]:
    """Return the reductions over samples, by the suffix of the method's name."""
    num_samples = max((cube.values.shape[1] for cube in cubes.values()), default=1)
    if num_samples == 1:
        return {"": statistics.mean_of_samples}
    suffix = f", best of {num_samples}"
    reductions: dict[str, statistics.Reduction] = {
        f", mean of {num_samples}": statistics.mean_of_samples,
        suffix: statistics.best_of_samples,
    }
    for key, facts in protocol["metrics"].items():
        direction = stored_facts.higher_is_better(key, facts)
        if key in cubes and direction is not None:
            name = f"{suffix} by {stored_facts.title(key)}"
            return {**reductions, name: statistics.best_by(cubes[key], direction)}
    return reductions
