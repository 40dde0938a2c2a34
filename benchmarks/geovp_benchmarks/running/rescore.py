"""Scores of kept predictions with other metrics: nothing is predicted, no data set is needed."""

from geovp_benchmarks.matrix.values import Specs
from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.results.provenance import content_hash, protocol_id, versions
from geovp_benchmarks.results.store import Method, Part, Results
from geovp_benchmarks.running.profiling import Usage
from geovp_benchmarks.running.run import totals, write
from geovp_benchmarks.running.scoring import Metrics, ScoredClip, score
from geovp_benchmarks.running.task import Scored
from geovp_classic.errors import BadData


def stored_metrics(results: Results) -> Metrics:
    """Build the metrics of a results folder."""
    specs: dict[str, Specs] = {"frame": {}, "trajectory": {}}
    protocol = results.protocol()
    for name, about in protocol["metrics"].items():
        if "asked" in about:
            specs[about["role"]][name] = about["asked"]
    return Metrics.build(specs["frame"], specs["trajectory"], protocol["size_px"])


def rescore(
    results: Results, output: Results, metrics: Metrics, progress: Progress
) -> list[Method]:
    """Write a results folder of the kept clips alone; raise BadData if there are none."""
    protocol = results.protocol()
    stored = {clip for clip, _ in results.clips()}
    clips = [clip for clip in protocol["clips"] if clip in stored]
    if not clips:
        raise BadData(
            f"{results.root} keeps no predictions: run it again with --keep N or --keep all"
        )
    protocol |= {
        "clips": clips,
        "metrics": metrics.about,
        "versions": versions(),
        "fingerprint": content_hash([protocol["fingerprint"], "rescored"]),
        "rescored_from": str(results.root),
    }
    protocol["id"] = protocol_id(protocol)
    output.write_protocol(protocol)
    methods = results.methods()
    for method in tracked(methods, len(methods), progress):
        _rescore_method(results, output, method, metrics)
    return output.methods()


def _rescore_method(results: Results, output: Results, method: Method, metrics: Metrics) -> None:
    """Copy and score the kept predictions of a method."""
    name, protocol = method.name, output.protocol()
    output.remove_method(name)
    failures = results.failures(name)
    predicted = {clip for clip, _ in results.predictions(name)}
    scored: list[Scored] = []
    for clip_name in protocol["clips"]:
        if clip_name not in predicted:
            continue
        clip = ScoredClip(results.clip(clip_name), protocol["num_past"])
        prediction = results.prediction(name, clip_name)
        output.write_clip(clip.clip)
        output.write_prediction(name, clip_name, prediction)
        usage = Usage()
        with usage.measure("metrics"):
            scores = score(clip, prediction, metrics)
        part = Part([clip_name], method.fingerprint, {}, dict(usage.seconds), 0.0)
        part.facts[clip_name] = dict(clip.facts)
        if clip_name in failures:
            part.failures[clip_name] = ["failed", failures[clip_name], ""]
        scored.append((name, scores, part))
    status = method.status
    if status in ("done", "partial"):
        status = "done" if len(scored) == len(protocol["clips"]) else "partial"
    record = {**method.record, "status": status, "protocol_id": protocol["id"]}
    output.write_method(name, record)
    write(output, scored)
    output.write_method(name, record | totals(output.parts(name), ""))
