"""Verification of a results folder: recompute some stored scores, and compare."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from geovp.provenance import versions
from geovp_benchmarks.failure import Failure
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.matrix.stored import matrix_of
from geovp_benchmarks.results.store import Method, Results, ScoreRecord, Scores
from geovp_benchmarks.results.stored_facts import facts_of, metric_of
from geovp_benchmarks.running.task import Scored, Task, build_matrix, score_clip
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.types import PrivilegedInput


@dataclass(frozen=True)
class Pair:
    """Method and a clip that it has scores of."""

    results: Results
    method: Method
    clip: str

    @property
    def record(self) -> ScoreRecord:
        """Return how the clip was scored."""
        return self.method.scored[self.clip]


class Verdict(NamedTuple):
    """Comparison of stored with recomputed scores."""

    sentence: str  # with the largest differences and their units
    is_reproduced: bool = False  # all available metrics, within the tolerance
    unavailable: Mapping[str, str] = {}  # reasons by metric


def sample(results: Results, count: int, seed: int, root: Path | None) -> list[Pair]:
    """Draw pairs of method and clip without replacement, in the order of the folder.

    Raises BadData unless the data set is available with the same frames.
    """
    pairs = [Pair(results, method, clip) for method in results.methods() for clip in method.scored]
    if not pairs or "rescored_from" in results.protocol():
        raise BadData(
            f"{results.root} has no predictions that can be recomputed: give a folder in which "
            "`geovp run` has finished a method"
        )
    rng = np.random.default_rng(seed)
    indices = rng.choice(len(pairs), min(count, len(pairs)), replace=False)
    stored = results.protocol()["split_hash"]
    dataset = _matrix(pairs[0], root).build_dataset(PrivilegedInput.NONE)
    split_hash = str(getattr(dataset, "split_hash", ""))
    if split_hash != stored:
        raise BadData(
            f"the data set here has the split hash {split_hash or 'none'}, the results were "
            f"computed on {stored or 'none'}: give the same data with --root"
        )
    return [pairs[index] for index in sorted(indices)]


def verify(pair: Pair, root: Path | None, tolerance: float) -> Verdict:
    """Recompute stored scores, twice if they differ; nothing is written into the results."""
    label = f"{pair.method.label}, {pair.clip}"
    try:
        # The same method, data and metrics as stored, as far as they exist here.
        matrix = _matrix(pair, root)
        built = build_matrix(matrix.model_dump_json())
        predictor = built.predictors[pair.method.name]
        if isinstance(predictor, Failure):
            raise GeovpError(predictor.reason)
        recomputed, record = _recompute(pair, matrix)
        # Metrics that are unavailable here are not compared.
        stored = replace(pair.results, subset=frozenset({pair.clip})).scores(pair.method.name)
        unavailable = built.metrics.unavailable
        differences = {
            name: difference
            for name, difference in _differences(stored, recomputed).items()
            if metric_of(name) not in unavailable
        }
        is_random = differences and _differences(recomputed, _recompute(pair, matrix)[0])
    except GeovpError as problem:
        return Verdict(f"{label}: cannot be computed here: {problem}")
    # The verdict, with the three largest differences and what explains them.
    is_reproduced = max(differences.values(), default=0.0) <= tolerance
    words = ["identical"]
    if differences:
        protocol = pair.results.protocol()
        texts = [
            f"{name} {difference:.3g} {facts_of(name, protocol).get('unit', '')}".rstrip()
            for name, difference in sorted(differences.items(), key=lambda item: -item[1])
        ]
        agreement = "within the tolerance" if is_reproduced else "differs"
        words = [f"{agreement}: {', '.join(texts[:3])}"]
    words += [f"{name} cannot be compared" for name in unavailable]
    if is_random:
        words.append("not deterministic: two computations here differ as well")
    if record.code != pair.record.code:
        words.append(f"stored by code {pair.record.code}, here it is {record.code}")
    return Verdict(f"{label}: {'; '.join(words)}", is_reproduced, unavailable)


def other_versions(results: Results) -> Iterator[str]:
    """Yield the libraries whose versions differ between the results and this machine."""
    stored, here = results.protocol()["versions"], versions()
    for name in {**stored, **here}:
        if stored.get(name) != here.get(name):
            yield f"{name}: stored with {stored.get(name, 'none')}, here {here.get(name, 'none')}"


def _matrix(pair: Pair, root: Path | None) -> Matrix:
    """Return the matrix of a pair's method and metrics."""
    return matrix_of(pair.results, pair.method, root, pair.record.metrics)


def _recompute(pair: Pair, matrix: Matrix) -> Scored:
    """Return the scores of a pair; raise GeovpError if only this prediction fails."""
    content = matrix.model_dump_json()
    index = build_matrix(content).clip_names.index(pair.clip)
    task = Task(content, pair.results.root, index, pair.clip, "", [pair.method])
    [(scores, record)] = score_clip(task)
    if record.failures and pair.clip not in pair.record.failures:
        raise GeovpError(record.failures[pair.clip].reason)
    return scores, record


def _differences(*pair: Scores) -> dict[str, float]:
    """Return the largest difference of each metric with values that are not identical."""
    stored, recomputed = (
        {
            (metric, sample, step): value
            for _, sample, step, metric, value in scores.rows()
            if not math.isnan(value)
        }
        for scores in pair
    )
    differences: dict[str, float] = {}
    for key in stored.keys() | recomputed.keys():
        difference = abs(stored.get(key, math.inf) - recomputed.get(key, math.inf))
        if difference > 0:
            differences[key[0]] = max(differences.get(key[0], 0.0), difference)
    return differences
