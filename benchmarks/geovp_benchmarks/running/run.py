"""Compute the missing and stale results of a matrix, however earlier runs ended."""

import itertools
import logging
from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, field
from typing import Any

from geovp_benchmarks.matrix.components import Failure, weights_of
from geovp_benchmarks.matrix.schema import Matrix, MethodPlan
from geovp_benchmarks.progress import Progress, announce
from geovp_benchmarks.results.provenance import content_hash
from geovp_benchmarks.results.store import Method, Part, Results
from geovp_benchmarks.running.built_matrix import Task, TaskResult, compute
from geovp_benchmarks.running.executors import Executor
from geovp_benchmarks.running.planning import Options, Plan, prepare
from geovp_classic import registry
from geovp_classic.types import PrivilegedInput

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class _State:
    """Clips still to be computed of each method that can be, and the methods' failures."""

    missing: dict[str, set[str]]  # method -> clips
    # method -> the index of its first clip that failed, and why
    failures: dict[str, tuple[int, Failure]] = field(default_factory=dict)

    @property
    def num_left(self) -> int:
        """Clips times methods that are still to be done."""
        return sum(len(clips) for name, clips in self.missing.items() if name not in self.failures)


def run(
    matrix: Matrix, results: Results, options: Options, executor: Executor, progress: Progress
) -> list[Method]:
    """Compute missing results and return all methods; BadData when the matrix or the data set is
    wrong.
    """
    announce("looking at components, metrics and clips")
    plan = prepare(matrix, results, options)
    for name in (None, *(method.name for method in matrix.methods)):
        for path in results.set_damaged_aside(name):
            logger.warning(
                "%s was damaged: it is set aside as %s.damaged and computed again", path, path.name
            )
    plans = {method.name: method for method in matrix.methods}
    records = {name: _begin(plan, method) for name, method in plans.items()}
    state = _State(
        {
            name: set(_missing(plan, name, record["code"]))
            for name, record in records.items()
            if "code" in record
        }
    )
    total = state.num_left
    progress(0, total)
    announce("first prediction: reading a clip, loading or compiling code")
    try:
        for result in executor.map(compute, _tasks(plan, state, records)):
            _update(result, state)
            progress(total - state.num_left, total)
            clips = ", ".join(result.task.clips.values())
            announce(f"after {clips}")  # other processes do not say what they do
            logger.info("clips %s: done", clips)
    finally:
        for name in state.missing:
            _finish(plan, name, records[name], state)
    return results.methods()


def _begin(plan: Plan, method: MethodPlan) -> dict[str, Any]:
    """Write and return a method's record, without a fingerprint when it cannot be built; stale rows
    are set aside.
    """
    own = plan.built.components_of(method)
    before = plan.results.method(method.name)
    failure, record = record_of(plan, method)
    if failure is not None:
        _begin_without(plan, method.name, record, failure)
        return record
    if before is None or before.fingerprint != record["fingerprint"]:
        plan.results.swap(method.name, before.fingerprint if before else "", record["fingerprint"])
    record |= {"about": weights_of(own.values()), "protocol_id": plan.results.protocol()["id"]}
    record["code"] = plan.built.code(method)
    tally = _tally(plan.results.parts(method.name), record["code"])
    plan.results.write_method(method.name, {**record, "status": "partial", **tally})
    return record


def record_of(plan: Plan, method: MethodPlan) -> tuple[Failure | None, dict[str, Any]]:
    """Why a method cannot be built here, if so, and its record, which then has no fingerprint."""
    own = plan.built.components_of(method)
    names = (
        {"pose_source": method.pose_source, "renderer": method.renderer}
        if method.predictor is None
        else {}
    )
    record: dict[str, Any] = {
        "label": method.label,
        "kind": method.kind,
        **names,
        "num_samples": method.num_samples,
    }
    asked = {role: plan.built.matrix.specs[key] for role, key in method.components.items()}
    record |= {"asked": asked, "protocol": plan.shared}
    failures = [each for each in own.values() if isinstance(each, Failure)]
    if failures:
        return failures[0], record
    components = {role: registry.describe(each) for role, each in own.items()}
    needs = plan.built.needs(method)
    record |= {
        "components": components,
        "privileged_inputs": [str(each.name) for each in PrivilegedInput if each in needs],
    }
    record["fingerprint"] = content_hash([plan.shared, components, method.num_samples])
    return None, record


def _begin_without(plan: Plan, name: str, record: Mapping[str, Any], failure: Failure) -> None:
    """Write the record of a method that cannot be built here, unless its rows were computed where
    it could.
    """
    before = plan.results.method(name)
    same = before is not None and all(
        before.record.get(key) == value for key, value in record.items()
    )
    if before is None or not same or before.num_clips == 0:
        plan.results.swap(name, before.fingerprint if before else "", "")
        nothing = {"components": {}, "privileged_inputs": [], "fingerprint": "", **_tally([])}
        plan.results.write_method(
            name, {**record, **nothing, "status": failure.status, "reason": failure.reason}
        )


def _missing(plan: Plan, name: str, code: str) -> frozenset[str]:
    """The clips that a method lacks."""
    results = plan.results
    kept = {clip for clip, _ in results.predictions(name)} & {clip for clip, _ in results.clips()}
    return lacking(plan, results.parts(name), kept, code)


def lacking(plan: Plan, parts: Iterable[Part], kept: Set[str], code: str) -> frozenset[str]:
    """The clips that a method with these parts and kept clips lacks.

    Clips of other code are missing only with `fresh`.
    """
    specs = plan.built.metrics.describe(plan.columns)
    stored: set[str] = set()
    for part in parts:
        is_measured = all(part.metrics.get(column) == spec for column, spec in specs.items())
        if is_measured and not (plan.fresh and part.code != code):
            broken = {clip for clip, (status, *_) in part.failures.items() if status == "failed"}
            stored |= set(part.clips) - broken
    return frozenset(plan.clips) - (stored - (plan.kept - kept))


def _tasks(plan: Plan, state: _State, records: Mapping[str, Mapping[str, Any]]) -> Iterator[Task]:
    """Tasks of clips that the same methods lack, without the methods that have failed by then."""
    matrix = plan.built.matrix
    lacked_by = {
        clip: tuple(name for name, missing in state.missing.items() if clip in missing)
        for clip in plan.clips
    }
    numbered = [(index, clip) for index, clip in enumerate(plan.clips) if lacked_by[clip]]
    for names, group in itertools.groupby(numbered, lambda entry: lacked_by[entry[1]]):
        while clips := list(itertools.islice(group, plan.clips_per_task)):
            left = set(names) - state.failures.keys()
            if left:
                yield Task(
                    matrix=matrix.to_json(),
                    root=str(plan.results.root),
                    clips=dict(clips),
                    methods=tuple(method for method in matrix.methods if method.name in left),
                    fingerprints={name: str(records[name]["fingerprint"]) for name in left},
                    columns=plan.columns,
                    kept=plan.kept,
                )


def _update(result: TaskResult, state: _State) -> None:
    """Update the missing clips; of several failures of a method the first clip's is kept."""
    index = min(result.task.clips)
    for method in result.task.methods:
        failure = result.failures.get(method.name)
        if failure is None:
            state.missing[method.name].difference_update(result.task.clips.values())
        elif method.name not in state.failures or index < state.failures[method.name][0]:
            state.failures[method.name] = (index, failure)


def _finish(plan: Plan, name: str, record: Mapping[str, Any], state: _State) -> None:
    plan.results.merge(name)
    verdict: dict[str, Any] = {"status": "partial" if state.missing[name] else "done"}
    if name in state.failures:
        failure = state.failures[name][1]
        verdict = {
            "status": failure.status,
            "reason": failure.reason,
            "traceback": failure.traceback,
        }
    parts = plan.results.parts(name)
    failures = [failure for part in parts for failure in part.failures.values()]
    if failures and len(failures) == sum(len(part.clips) for part in parts):  # it predicted nothing
        verdict = dict(zip(("status", "reason", "traceback"), failures[0], strict=True))
        plan.results.remove_method(name)
        parts = []
    elif failures and verdict["status"] == "done":
        verdict["traceback"] = next((trace for *_, trace in failures if trace), "")
    if verdict.get("traceback"):
        logger.info(
            "%s: %s\n%s", record["label"], verdict.get("reason", ""), verdict["traceback"].rstrip()
        )
    plan.results.write_method(name, {**record, **verdict, **_tally(parts, record["code"])})


def _tally(parts: list[Part], code: str = "") -> dict[str, Any]:
    """Totals over the parquet parts of a method; outdated clips are those that other
    code computed.
    """
    stages = dict.fromkeys(stage for part in parts for stage in part.seconds)
    seconds = {
        stage: round(sum(part.seconds.get(stage, 0.0) for part in parts), 3) for stage in stages
    }
    return {
        "num_clips": sum(len(part.clips) for part in parts),
        "num_failed": sum(len(part.failures) for part in parts),
        "num_outdated": sum(len(part.clips) for part in parts if part.code != code),
        "seconds": seconds,
        "peak_memory_mb": max((part.peak_memory_mb for part in parts), default=0.0),
        "peak_is_own": all(part.peak_is_own for part in parts),
    }
