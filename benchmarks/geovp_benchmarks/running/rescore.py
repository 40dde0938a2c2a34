"""Scores of kept predictions with other metrics: nothing is predicted, no data set is needed."""

from geovp.progress import tracked
from geovp.provenance import versions
from geovp_benchmarks.matrix.values import Specs
from geovp_benchmarks.results.provenance import content_hash, protocol_id
from geovp_benchmarks.results.store import Method, Results, ScoreRecord
from geovp_benchmarks.running.scoring import Metrics, ScoredClip, score
from geovp_benchmarks.running.task import Scored
from geovp_classic.errors import BadData


def stored_metrics(results: Results) -> Metrics:
    """Build the metrics of a results folder."""
    specs: dict[str, Specs] = {"frame": {}, "trajectory": {}, "set": {}}
    protocol = results.protocol()
    for name, about in protocol["metrics"].items():
        if "asked" in about:
            specs[about["role"]][name] = about["asked"]
    return Metrics.build(specs, protocol["size_px"])


def rescore(results: Results, output: Results, metrics: Metrics) -> None:
    """Write a results folder of the kept clips alone; raise BadData if there are none."""
    protocol = results.protocol()
    stored = set(results.clips().names)
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
    output.write_protocol({**rescored, "id": protocol_id(rescored)})
    for method in tracked(results.methods()):
        status = "done" if method.status == "partial" else method.status  # if no clip lacks scores
        output.write_method(method.model_copy(update={"code": "", "status": status}))
        names = set(results.predictions(method).names).intersection(clips)
        scored = [_rescored(results, output, method, metrics, name) for name in sorted(names)]
        output.write_scores(scored)


def _rescored(
    results: Results, output: Results, method: Method, metrics: Metrics, name: str
) -> Scored:
    """Copy the kept prediction of a clip; return its scores."""
    clip = ScoredClip(results.clips().read(name), results.protocol()["num_past"])
    prediction = results.predictions(method).read(name)
    output.clips().write(name, clip.clip)
    output.predictions(method).write(name, prediction)
    scores = score(clip, prediction, metrics)
    record = ScoreRecord(
        method.name,
        [name],
        method.fingerprint,
        failures=method.scored.failures,
        facts={name: {**results.clip_facts().get(name, {}), **clip.facts}},
        shown_by={name: prediction.shown_by} if prediction.shown_by else {},
        digests={name: results.digests.get(name, "")},
    )
    return scores, record
