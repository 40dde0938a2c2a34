"""Dry run: what a run would compute, and about how long."""

from geovp_benchmarks.running.plan import Plan
from geovp_benchmarks.tables.formats import grid


def dry_run(plan: Plan, workers: int) -> list[str]:
    """Return lines that state what is to be computed of the shard; nothing is written.

    Times are those of stored scores, and unknown for methods without any. Steps that methods share
    count once. A single stored clip gives an upper bound, since it includes loading and compiling.
    """
    lines = [["method", "to do", "stored", "s per clip"]]
    of_shard = set(plan.own_clips)
    num_missing = num_unknown = 0  # predictions; of the latter the time is unknown
    steps: dict[tuple[str, float], int] = {}  # clips by stage and s per clip, equal if shared
    bound = ""
    for method in plan.methods:
        num_clips = len(plan.missing(method) & of_shard)
        num_missing += num_clips
        scored = plan.results.scored(method.name, method.fingerprint, plan.digests)
        note = method.reason or "unknown"
        if seconds := scored.seconds:
            note = f"{sum(seconds.values()) / len(scored):.2f}"
            for stage, time_s in seconds.items():
                step = stage, time_s / len(scored)
                steps[step] = max(num_clips, steps.get(step, 0))
            if num_clips and len(scored) == 1:
                bound = "at most "
        else:
            num_unknown += num_clips
        lines.append([method.label, str(num_clips), str(len(of_shard) - num_clips), note])
    num_stored = len(plan.methods) * len(of_shard) - num_missing
    if not num_missing:
        time = "none"
    elif num_unknown == num_missing:
        time = "unknown"
    else:
        total_s = sum(num_clips * per_clip_s for (_, per_clip_s), num_clips in steps.items())
        time = f"{bound}about {max(total_s / workers / 60, 0.1):.1f} min with {workers} "
        time += "process" if workers == 1 else "processes"
        if num_unknown:
            time += f", and unknown for {num_unknown} predictions"
    return [
        *grid(lines),
        f"predictions: {num_missing} to do, {num_stored} stored",
        f"time: {time}",
    ]
