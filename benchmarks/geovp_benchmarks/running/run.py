"""Run of a matrix: compute what is missing in its results folder, however earlier runs ended."""

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from geovp_benchmarks.matrix.schema import Matrix, MethodPlan
from geovp_benchmarks.progress import Progress, announce
from geovp_benchmarks.results.provenance import content_hash
from geovp_benchmarks.results.store import Method, Part, Results
from geovp_benchmarks.running.executors import Executor
from geovp_benchmarks.running.locking import results_lock
from geovp_benchmarks.running.plan import Options, Plan, make_plan
from geovp_benchmarks.running.selection import Ranking
from geovp_benchmarks.running.task import compute

logger = logging.getLogger(__name__)


def run(
    matrix: Matrix, results: Results, options: Options, executor: Executor, progress: Progress
) -> list[Method]:
    """Compute missing and outdated scores, and return all methods.

    With a ranking, all methods then predict the selected clips once more. Raises BadData if the
    matrix, the data set or the folder is unsuitable.
    """
    announce("building components and metrics")
    plan = make_plan(matrix, results, options)
    with results_lock(results.root, content_hash([plan.fingerprint, matrix.to_json(), plan.clips])):
        compute_missing(plan, executor, progress)
        if isinstance(options.keep, Ranking):
            options = replace(options, keep=options.keep.choose(results))
            compute_missing(replace(plan, options=options), executor, progress)
    return results.methods()


def compute_missing(plan: Plan, executor: Executor, progress: Progress) -> None:
    """Predict and score the clips that methods lack; store what is done, whatever happens."""
    records = begin(plan)
    missing = {method: plan.missing(method, record) for method, record in records.items()}
    num_missing = sum(len(clips) for clips in missing.values())
    num_done = 0
    progress(num_done, num_missing)
    announce("first prediction: reading a clip, loading or compiling code")
    try:
        for task in executor.map(compute, plan.tasks(missing, records)):
            num_done += len(task.fingerprints)
            progress(num_done, num_missing)
            announce(f"after {task.clip}")  # other processes do not announce their steps
            logger.info("clip %s: done", task.clip)
    finally:
        for method, record in records.items():
            finish(plan, method, record)


def begin(plan: Plan) -> dict[MethodPlan, dict[str, Any]]:
    """Write the records of the protocol and of all methods; return those of buildable methods.

    Results of other settings are set aside, and so are damaged files.
    """
    results = plan.results
    fingerprint = results.protocol()["fingerprint"] if results.begun else ""
    if fingerprint != plan.fingerprint:
        results.swap("clips", fingerprint, plan.fingerprint)
    protocol = plan.protocol()
    results.write_protocol(protocol)
    methods = plan.built.matrix.methods
    for name in (None, *(method.name for method in methods)):
        for path in results.set_damaged_aside(name):
            logger.warning(
                "%s was damaged: it is set aside as %s.damaged and computed again", path, path.name
            )
    records = {method: plan.record(method) | {"protocol_id": protocol["id"]} for method in methods}
    for method, record in records.items():
        stored = results.method(method.name)
        asked = ("asked", "num_samples", "protocol")
        is_same = stored and all(stored.record.get(key) == record[key] for key in asked)
        if stored and stored.num_clips and is_same and not record["fingerprint"]:
            continue  # computed on a machine that could build it
        fingerprint = stored.fingerprint if stored else ""
        if stored is None or fingerprint != record["fingerprint"]:
            results.swap(method.name, fingerprint, record["fingerprint"])
        results.write_method(method.name, record | totals([], ""))
    return {method: record for method, record in records.items() if record["fingerprint"]}


def finish(plan: Plan, method: MethodPlan, record: dict[str, Any]) -> None:
    """Merge the score files of a method and write its status."""
    results = plan.results
    results.merge(method.name)
    parts = results.parts(method.name)
    is_partial = plan.missing(method, record, retry_failed=False)
    outcome = {"status": "partial" if is_partial else "done"}
    failures = [failure for part in parts for failure in part.failures.values()]
    if failures:
        status, reason, traceback = failures[0]
        outcome["traceback"] = traceback
        logger.info("%s: %s\n%s", method.label, reason, traceback.rstrip())
        if len(failures) == sum(len(part.clips) for part in parts):  # nothing was predicted
            outcome |= {"status": status, "reason": reason}
            results.remove_method(method.name)
            parts = []
    results.write_method(method.name, record | outcome | totals(parts, record["code"]))


def totals(parts: Sequence[Part], code: str) -> dict[str, Any]:
    """Return the numbers of clips, the seconds per stage and the peak memory of score files.

    Scores of code with another hash are outdated.
    """
    seconds: Counter[str] = Counter()
    for part in parts:
        seconds.update(part.seconds)
    return {
        "num_clips": sum(len(part.clips) for part in parts),
        "num_failed": sum(len(part.failures) for part in parts),
        "num_outdated": sum(len(part.clips) for part in parts if part.code != code),
        "seconds": {stage: round(time_s, 3) for stage, time_s in seconds.items()},
        "peak_memory_mb": max((part.peak_memory_mb for part in parts), default=0.0),
        "peak_is_own": all(part.peak_is_own for part in parts),
    }
