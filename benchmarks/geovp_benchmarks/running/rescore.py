"""Scores of kept predictions with other metrics: nothing is predicted, no data set is needed."""

from geovp_benchmarks.matrix.values import Specs
from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.results.provenance import content_hash, protocol_id, versions
from geovp_benchmarks.results.store import Method, Results, ScoreRecord
from geovp_benchmarks.running.profiling import Usage
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
    stored = set(results.clips())
    clips = [clip for clip in protocol["clips"] if clip in stored]
    if not clips:
        raise BadData(
            f"{results.root} keeps no predictions: run it again with --keep N or --keep all"
        )
    rescored = {
        **protocol,
        "clips": clips,
        "metrics": metrics.about,
        "versions": versions(),
        "fingerprint": content_hash([protocol["fingerprint"], "rescored"]),
        "rescored_from": str(results.root),
    }
    rescored["id"] = protocol_id(rescored)
    output.write_protocol(rescored)
    methods = results.methods()
    for method in tracked(methods, len(methods), progress):
        _rescore_method(results, output, method, metrics)
    return output.methods()


def _rescore_method(results: Results, output: Results, method: Method, metrics: Metrics) -> None:
    """Copy and score the kept predictions of a method."""
    name, protocol = method.name, output.protocol()
    output.remove_method(name)
    status = "done" if method.status == "partial" else method.status  # if no clip lacks scores
    output.write_method(name, method.record | {"code": "", "status": status})
    stored = results.score_records(name)
    failures = {clip: why for record in stored for clip, why in record.failures.items()}
    scored: list[Scored] = []
    for clip_name in sorted(set(protocol["clips"]).intersection(results.predictions(name))):
        clip = ScoredClip(results.clip(clip_name), protocol["num_past"])
        prediction = results.prediction(name, clip_name)
        output.write_clip(clip.clip)
        output.write_prediction(name, clip_name, prediction)
        usage = Usage()
        with usage.measure("metrics"):
            scores = score(clip, prediction, metrics)
        record = ScoreRecord(name, [clip_name], method.fingerprint, seconds=dict(usage.seconds))
        if clip_name in failures:
            record.failures[clip_name] = failures[clip_name]
        scored.append((scores, record))
    output.write_scores(scored)
