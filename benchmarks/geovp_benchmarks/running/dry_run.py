"""Dry run: what a run would compute, and about how long and how large it would be."""

from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.running.plan import Options, make_plan
from geovp_benchmarks.tables.formats import grid


def dry_run(matrix: Matrix, results: Results, options: Options, workers: int) -> list[str]:
    """Return lines that state what is to be computed; nothing is written.

    Times and sizes are those of earlier runs, and unknown for methods without scores.
    """
    plan = make_plan(matrix, results, options)
    lines = [["method", "to do", "stored", "s per clip"]]
    num_missing = num_untimed = 0
    total_s = size_bytes = 0.0
    for method, record in plan.records.items():
        clips = plan.missing(method)
        num_missing += len(clips)
        scored = results.score_records(method.name, record["fingerprint"])
        num_scored = sum(len(each.clips) for each in scored)
        note = f"{record['status']}: {record['reason']}" if "reason" in record else "unknown"
        if num_scored:
            per_clip_s = sum(sum(each.seconds.values()) for each in scored) / num_scored
            note = f"{per_clip_s:.2f}"
            total_s += len(clips) * per_clip_s
            size_bytes += len(clips) / num_scored * results.size_bytes(method.name, "scores")
        num_untimed += bool(clips and not num_scored)
        lines.append([method.label, str(len(clips)), str(len(plan.clips) - len(clips)), note])
        predictions = results.predictions(method.name, record["fingerprint"])
        if predictions:
            ratio = len(clips & set(plan.kept.clips)) / len(predictions)
            size_bytes += ratio * results.size_bytes(method.name, "predictions")
    num_stored = len(plan.records) * len(plan.clips) - num_missing
    minutes, rest_s = divmod(round(total_s / workers), 60)
    return [
        *grid(lines),
        f"predictions: {num_missing} to do, {num_stored} stored",
        f"time: up to {minutes} min {rest_s} s with {workers} process{'es' * (workers > 1)}, "
        f"without {num_untimed} methods that have not run",
        f"disk: about {size_bytes / 1e6:.1f} MB without figures and report",
    ]
