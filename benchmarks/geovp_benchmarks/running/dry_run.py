"""Dry run: what a run would compute, and about how long."""

from geovp_benchmarks.running.plan import Plan
from geovp_benchmarks.tables.formats import grid


def dry_run(plan: Plan, workers: int) -> list[str]:
    """Return lines that state what is to be computed of the shard; nothing is written.

    Times are those of stored scores, and unknown for methods without any.
    """
    lines = [["method", "to do", "stored", "s per clip"]]
    of_shard = set(plan.own_clips)
    num_missing = num_unknown = 0  # predictions; of the latter the time is unknown
    total_s = 0.0
    for method in plan.methods:
        num_clips = len(plan.missing(method) & of_shard)
        num_missing += num_clips
        scored = plan.results.scored(method.name, method.fingerprint, plan.digests)
        note = method.reason or "unknown"
        if scored.seconds:
            per_clip_s = sum(scored.seconds.values()) / len(scored)
            note = f"{per_clip_s:.2f}"
            total_s += num_clips * per_clip_s
        else:
            num_unknown += num_clips
        lines.append([method.label, str(num_clips), str(len(of_shard) - num_clips), note])
    num_stored = len(plan.methods) * len(of_shard) - num_missing
    if not num_missing:
        time = "none"
    elif num_unknown == num_missing:
        time = "unknown"
    else:
        time = f"about {max(total_s / workers / 60, 0.1):.1f} min with {workers} "
        time += "process" if workers == 1 else "processes"
        if num_unknown:
            time += f", and unknown for {num_unknown} predictions"
    return [
        *grid(lines),
        f"predictions: {num_missing} to do, {num_stored} stored",
        f"time: {time}",
    ]
