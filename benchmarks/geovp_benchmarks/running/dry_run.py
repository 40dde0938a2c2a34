"""What a run would do, and about how long and how large it would be; nothing is written to the
results.
"""

import os
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from geovp_benchmarks.matrix.schema import Matrix, MethodPlan
from geovp_benchmarks.progress import Progress
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.running.executors import Serial
from geovp_benchmarks.running.planning import Options, Plan, look
from geovp_benchmarks.running.run import lacking, record_of
from geovp_benchmarks.running.run import run as fill
from geovp_benchmarks.tables.formats import columns

SHARED = "motion"  # the stage that the rows of one pose source share


@dataclass(frozen=True)
class Cost:
    """What one clip takes in one row."""

    seconds: Mapping[str, float]  # per stage
    score_bytes: float
    prediction_bytes: float  # where the prediction is kept
    is_stored: bool  # measured by an earlier run, not just now


@dataclass(frozen=True)
class MethodEstimate:
    """One row: clips to compute and to keep as they are, or why it cannot be computed."""

    method: MethodPlan
    todo: frozenset[str]
    kept: int
    reason: str = ""
    cost: Cost | None = None


def rows(
    matrix: Matrix, results: Results, options: Options, progress: Progress
) -> tuple[Plan, list[MethodEstimate]]:
    """The plan of every row; one clip is predicted with all rows, once, where some row has no
    stored times.
    """
    plan = look(matrix, results, options)
    found = [_row(plan, method) for method in matrix.methods]
    if all(row.cost or not row.todo for row in found):
        return plan, found
    with tempfile.TemporaryDirectory() as folder:
        trial = Results(Path(folder))
        fill(matrix, trial, Options(limit=1, keep=1), Serial(), progress)
        return plan, [_completed(row, trial) for row in found]


def describe(plan: Plan, found: list[MethodEstimate], workers: int) -> list[str]:
    """The rows as a table, and what they take together."""
    lines = [["row", "to do", "kept", "s a clip"]]
    for row in found:
        takes = "" if row.cost is None else f"{sum(row.cost.seconds.values()):.2f}"
        lines.append([row.method.label, str(len(row.todo)), str(row.kept), row.reason or takes])
    todo, kept = sum(len(row.todo) for row in found), sum(row.kept for row in found)
    measured = [row.cost for row in found if row.todo and row.cost]
    stored = sum(cost.is_stored for cost in measured)
    source = (
        f"{stored} rows by the times stored with their clips, {len(measured) - stored} by one "
        "clip timed just now"
    )
    minutes, seconds = divmod(round(_seconds(found) / workers), 60)
    root = Path(os.path.realpath(plan.results.root))
    while not root.exists():
        root = root.parent
    free = f"{shutil.disk_usage(root).free / 1e9:.1f} GB are free"
    return [
        *columns(lines),
        f"predictions: {todo} to do, {kept} kept",
        f"time: about {minutes} min {seconds} s with {workers} process{'es' * (workers > 1)} "
        f"({source})",
        f"disk: about {_bytes(plan, found) / 1e6:.1f} MB without figures and report; {free}",
    ]


def _row(plan: Plan, method: MethodPlan) -> MethodEstimate:
    failure, record = record_of(plan, method)
    if failure is not None:
        return MethodEstimate(method, frozenset(), 0, f"{failure.status}: {failure.reason}")
    source = plan.results.with_rows_of(method.name, record["fingerprint"])
    clips = {clip for clip, _ in plan.results.with_clips_of(plan.shared).clips()}
    kept = {clip for clip, _ in source.predictions(method.name)} & clips
    todo = lacking(plan, source.parts(method.name), kept, plan.built.code(method))
    return MethodEstimate(
        method, todo, len(plan.clips) - len(todo), cost=_cost(source, method.name, is_stored=True)
    )


def _completed(row: MethodEstimate, trial: Results) -> MethodEstimate:
    """The row with the trial's cost where none is stored, and with the reason where the trial
    failed.
    """
    tried = trial.method(row.method.name)
    if row.cost or tried is None:
        return row
    reason = "" if tried.status == "done" else f"{tried.status}: {tried.reason}"
    return replace(row, reason=reason, cost=_cost(trial, row.method.name, is_stored=False))


def _cost(results: Results, method: str, *, is_stored: bool) -> Cost | None:
    """A row's cost by its parts; None when it has none."""
    parts = results.parts(method)
    clips, kept = sum(len(part.clips) for part in parts), len(results.predictions(method))
    if not clips:
        return None
    stages = {stage for part in parts for stage in part.seconds}
    seconds = {
        stage: sum(part.seconds.get(stage, 0.0) for part in parts) / clips for stage in stages
    }
    size = results.size_bytes(method, "predictions") / max(kept, 1)
    return Cost(seconds, results.size_bytes(method, "scores") / clips, size, is_stored)


def _seconds(found: list[MethodEstimate]) -> float:
    """Of all rows in one process; rows of one pose source estimate its motion once."""
    total, shared = 0.0, dict[str, float]()
    for row in (row for row in found if row.cost):
        assert row.cost is not None
        once = row.cost.seconds.get(SHARED, 0.0)
        total += len(row.todo) * (sum(row.cost.seconds.values()) - once)
        source = str(row.method.pose_source)
        shared[source] = max(shared.get(source, 0.0), len(row.todo) * once)
    return total + sum(shared.values())


def _bytes(plan: Plan, found: list[MethodEstimate]) -> float:
    rows_with_cost = [(row, row.cost) for row in found if row.cost]
    scores = sum(len(row.todo) * cost.score_bytes for row, cost in rows_with_cost)
    return scores + sum(
        len(row.todo & plan.kept) * cost.prediction_bytes for row, cost in rows_with_cost
    )
