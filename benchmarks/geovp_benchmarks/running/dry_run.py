"""Dry run: what a run would compute, and about how long."""

from geovp_benchmarks.running.plan import Plan
from geovp_benchmarks.tables.formats import grid


def dry_run(plan: Plan, workers: int) -> list[str]:
    """Return lines that state what is to be computed of the shard; nothing is written.

    Times are those of stored scores, and unknown for methods without any.
    """
    lines = [["method", "to do", "stored", "s per clip"]]
    num_missing, total_s, unknown = 0, 0.0, 0
    of_shard = set(plan.own_clips)
    for method in plan.methods:
        clips = plan.missing(method) & of_shard
        num_missing += len(clips)
        scored = plan.results.scored(method.name, method.fingerprint, plan.digests)
        note = method.reason or "unknown"
        if scored.seconds:
            per_clip_s = sum(scored.seconds.values()) / len(scored)
            note = f"{per_clip_s:.2f}"
            total_s += len(clips) * per_clip_s
        else:
            unknown += len(clips)
        lines.append([method.label, str(len(clips)), str(len(of_shard) - len(clips)), note])
    num_stored = len(plan.methods) * len(of_shard) - num_missing
    time = "unknown" if num_missing else "none"
    if unknown < num_missing:
        time = f"about {total_s / workers / 60:.1f} min with {workers} process"
        time += "es" * (workers > 1)
        if unknown:
            time += f", and unknown for {unknown} predictions"
    return [
        *grid(lines),
        f"predictions: {num_missing} to do, {num_stored} stored",
        f"time: {time}",
    ]
