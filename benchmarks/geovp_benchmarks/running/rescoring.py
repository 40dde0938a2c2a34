"""Score kept predictions again, with the metrics as they are now: nothing is predicted, no data set
is needed.
"""

from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.results.provenance import content_hash, protocol_id, versions
from geovp_benchmarks.results.store import Method, Part, Results, Rows
from geovp_benchmarks.running.metric_set import MetricSet
from geovp_benchmarks.running.profiling import StageProfiler
from geovp_benchmarks.running.scoring import Metrics, ScoringContext, score
from geovp_classic.errors import BadData


def stored_metrics(results: Results) -> MetricSet:
    """The metrics of a results folder."""
    roles: dict[str, dict[str, dict[str, object]]] = {"frame": {}, "trajectory": {}}
    for name, about in results.protocol()["metrics"].items():
        if "asked" in about:
            roles[about["role"]][name] = about["asked"]
    return MetricSet.build(roles["frame"], roles["trajectory"])


def rescore(
    results: Results, into: Results, metrics: MetricSet, progress: Progress
) -> list[Method]:
    """Write a results folder of the kept clips alone; BadData when none were kept."""
    protocol = results.protocol()
    kept = {clip for clip, _ in results.clips()}
    clips = [clip for clip in protocol["clips"] if clip in kept]
    if not clips:
        raise BadData(
            f"{results.root} keeps no predictions: run it again with --keep N or --keep all"
        )
    unavailable = metrics.unavailable(tuple(protocol["size_px"]))
    chosen = metrics.chosen(name for name in metrics.built if name not in unavailable)
    fingerprint = content_hash([protocol["fingerprint"], "rescored"])
    rescored = {
        **protocol,
        "clips": clips,
        "metrics": metrics.about(unavailable),
        "versions": versions(),
    }
    rescored |= {
        "fingerprint": fingerprint,
        "rescored_from": str(results.root),
        "id": protocol_id(rescored),
    }
    into.write_protocol(rescored)
    methods = results.methods()
    for method in tracked(methods, len(methods), progress):
        _rescore_method(results, into, method, clips, chosen)
    return into.methods()


def _rescore_method(
    results: Results, into: Results, method: Method, clips: list[str], metrics: Metrics
) -> None:
    num_past = int(results.protocol()["num_past"])
    predicted = {clip for clip, _ in results.predictions(method.name)}
    scored = [clip for clip in clips if clip in predicted]
    profiler, tables, facts = StageProfiler(), [], {}
    into.remove_method(method.name)
    for clip in scored:
        context = ScoringContext(results.clip(clip), num_past)
        prediction = results.prediction(method.name, clip)
        into.write_clip(context.clip)
        into.write_prediction(method.name, clip, prediction)
        facts[clip] = context.facts
        with profiler.measure("metrics"):
            tables.append(score(context, prediction, metrics))
    verdict = (
        {}
        if method.status in ("skipped", "failed")
        else {"status": "done" if scored == clips else "partial"}
    )
    failures = {
        clip: why
        for part in results.parts(method.name)
        for clip, why in part.failures.items()
        if clip in scored
    }
    tally = {
        "num_clips": len(scored),
        "num_failed": len(failures),
        "seconds": profiler.seconds,
        "peak_memory_mb": 0.0,
        "peak_is_own": False,
    }
    into.write_method(
        method.name, {**method.record, **verdict, **tally, "protocol_id": into.protocol()["id"]}
    )
    if tables:
        names, seconds = tuple(scored), profiler.seconds
        part = Part(names, method.fingerprint, {}, seconds, 0.0, failures=failures, facts=facts)
        into.write_part(method.name, Rows.concatenated(tables), part)
