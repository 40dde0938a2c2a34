"""Dry run: what a run would compute, and about how long and how large it would be."""

import tempfile
from pathlib import Path

from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.progress import Progress
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.running.executors import Serial
from geovp_benchmarks.running.plan import Options, make_plan
from geovp_benchmarks.running.run import run
from geovp_benchmarks.tables.formats import grid


def dry_run(
    matrix: Matrix, results: Results, options: Options, workers: int, progress: Progress
) -> list[str]:
    """Return lines that state what is to be computed; nothing is written to the results.

    Times and sizes are those of earlier runs. If some method has none, all methods predict one clip
    in a temporary folder.
    """
    plan = make_plan(matrix, results, options)
    missing = {method: plan.missing(method) for method in plan.records}
    lines = [["method", "to do", "stored", "s per clip"]]
    total_s = size_bytes = 0.0
    with tempfile.TemporaryDirectory() as folder:
        sources = dict.fromkeys(missing, results)
        untimed = [
            method
            for method, record in plan.records.items()
            if not results.parts(method.name, record["fingerprint"])
        ]
        if untimed:
            trial = Results(Path(folder))
            run(matrix, trial, Options(limit=1, keep="1"), Serial(), progress)
            sources |= dict.fromkeys(untimed, trial)
        for method, clips in missing.items():
            name, source, fingerprint = (
                method.name,
                sources[method],
                plan.records[method]["fingerprint"],
            )
            stored, parts = source.method(name), source.parts(name, fingerprint)
            num_clips = sum(len(part.clips) for part in parts) or 1
            per_clip_s = sum(sum(part.seconds.values()) for part in parts) / num_clips
            note = f"{per_clip_s:.2f}"
            if stored is not None and stored.reason:
                note = f"{stored.status}: {stored.reason}"
            lines.append([method.label, str(len(clips)), str(len(plan.clips) - len(clips)), note])
            total_s += len(clips) * per_clip_s
            num_kept = len(clips & set(plan.kept.clips)) / (
                len(source.predictions(name, fingerprint)) or 1
            )
            size_bytes += len(clips) / num_clips * source.size_bytes(name, "scores")
            size_bytes += num_kept * source.size_bytes(name, "predictions")
    num_missing = sum(len(clips) for clips in missing.values())
    minutes, rest_s = divmod(round(total_s / workers), 60)
    return [
        *grid(lines),
        f"predictions: {num_missing} to do, {len(missing) * len(plan.clips) - num_missing} stored",
        f"time: up to {minutes} min {rest_s} s with {workers} process{'es' * (workers > 1)}; "
        f"methods timed on one clip just now: {len(untimed)}",
        f"disk: about {size_bytes / 1e6:.1f} MB without figures and report",
    ]
