"""Dry run: what a run would compute, and about how long and how large it would be."""

import tempfile
from collections.abc import Hashable
from pathlib import Path

from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.progress import Progress
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.running.executors import Serial
from geovp_benchmarks.running.plan import Options, make_plan
from geovp_benchmarks.running.run import run, totals
from geovp_benchmarks.tables.formats import columns


def dry_run(
    matrix: Matrix, results: Results, options: Options, workers: int, progress: Progress
) -> list[str]:
    """Return lines that state what is to be computed; nothing is written to the results.

    Times and sizes are those of earlier runs. If some method has none, all methods predict one clip
    in a temporary folder.
    """
    plan = make_plan(matrix, results, options)
    records = {method: plan.record(method) for method in matrix.methods}
    missing = {method: plan.missing(method, record) for method, record in records.items()}
    sources = {
        method: results.with_rows_of(method.name, record["fingerprint"])
        for method, record in records.items()
    }
    lines = [["method", "to do", "stored", "s per clip"]]
    seconds: dict[Hashable, float] = {}
    size_bytes = 0.0
    num_missing = sum(len(clips) for clips in missing.values())
    with tempfile.TemporaryDirectory() as folder:
        untimed = [
            method
            for method, clips in missing.items()
            if clips and not sources[method].parts(method.name)
        ]
        if untimed:
            trial = Results(Path(folder))
            outcomes = run(matrix, trial, Options(limit=1, keep=1), Serial(), progress)
            for method, outcome in zip(matrix.methods, outcomes, strict=True):
                records[method] = dict(outcome.record)
            sources |= dict.fromkeys(untimed, trial)
        for method, clips in missing.items():
            name, source, record = method.name, sources[method], records[method]
            total = totals(source.parts(name), "")
            num_clips = total["num_clips"] or 1
            per_clip = {stage: s / num_clips for stage, s in total["seconds"].items()}
            note = f"{sum(per_clip.values()):.2f}"
            if record["status"] in ("skipped", "failed"):
                note = f"{record['status']}: {record['reason']}"
            lines.append([method.label, str(len(clips)), str(len(plan.clips) - len(clips)), note])
            shared = {"observe": "", "motion": method.pose_source}  # with other methods
            for stage, stage_s in per_clip.items():
                key = stage, shared.get(stage, name)
                seconds[key] = max(seconds.get(key, 0.0), len(clips) * stage_s)
            size_bytes += len(clips) / num_clips * source.size_bytes(name, "scores")
            num_kept = len(source.predictions(name)) or 1
            kept = clips & plan.kept
            size_bytes += len(kept) / num_kept * source.size_bytes(name, "predictions")
    minutes, rest_s = divmod(round(sum(seconds.values()) / workers), 60)
    num_stored = len(missing) * len(plan.clips) - num_missing
    return [
        *columns(lines),
        f"predictions: {num_missing} to do, {num_stored} stored",
        f"time: about {minutes} min {rest_s} s with {workers} process{'es' * (workers > 1)}; "
        f"methods timed on one clip just now: {len(untimed)}",
        f"disk: about {size_bytes / 1e6:.1f} MB without figures and report",
    ]
