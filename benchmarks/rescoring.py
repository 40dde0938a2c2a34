"""Score kept predictions again, with the metrics as they are now: nothing is predicted, no data set is needed."""

from __future__ import annotations

from collections.abc import Callable

import pyarrow as pa

from benchmarks.measures import Measures
from benchmarks.peaks import process_peak_mb
from benchmarks.planning import content_hash, versions
from benchmarks.remembering import Stopwatch
from benchmarks.scoring import Case, Metrics, score
from benchmarks.store import Cell, Part, Results
from geovp_classic.errors import BadData

Progress = Callable[[int, int], None]  # (predictions scored, predictions in all)


def stored_measures(results: Results) -> Measures:
    """The metrics that a results folder was made with."""
    roles: dict[str, dict[str, dict[str, object]]] = {"frame": {}, "trajectory": {}}
    for name, about in results.protocol()["metrics"].items():
        if "asked" in about:
            roles[about["role"]][name] = about["asked"]
    return Measures.build(roles["frame"], roles["trajectory"])


def rescore(results: Results, into: Results, measures: Measures, progress: Progress) -> list[Cell]:
    """Write a results folder of the kept clips alone; BadData when none were kept."""
    protocol = results.protocol()
    kept = {clip for clip, _ in results.clips()}
    clips = [clip for clip in protocol["clips"] if clip in kept]
    if not clips:
        raise BadData(f"{results.root} keeps no predictions: run it again with --keep N or --keep all")
    unavailable = measures.unavailable(tuple(protocol["size_px"]))
    chosen = measures.chosen(name for name in measures.built if name not in unavailable)
    fingerprint = content_hash([protocol["fingerprint"], "rescored"])
    into.write_protocol(
        {
            **protocol,
            "clips": clips,
            "metrics": measures.about(unavailable),
            "versions": versions(),
            "fingerprint": fingerprint,
            "rescored_from": str(results.root),
        }
    )
    cells = results.cells()
    for number, cell in enumerate(cells):
        _rescore_cell(results, into, cell, clips, chosen)
        progress(number + 1, len(cells))
    return into.cells()


def _rescore_cell(results: Results, into: Results, cell: Cell, clips: list[str], metrics: Metrics) -> None:
    num_past = int(results.protocol()["num_past"])
    predicted = {clip for clip, _ in results.predictions(cell.name)}
    scored = [clip for clip in clips if clip in predicted]
    watch, tables = Stopwatch(), []
    into.remove_cell(cell.name)
    for clip in scored:
        case, prediction = Case(results.clip(clip), num_past), results.prediction(cell.name, clip)
        into.write_clip(case.clip)
        into.write_prediction(cell.name, clip, prediction)
        _ = case.pixel_sets
        with watch.time("metrics"):
            tables.append(score(case, prediction, metrics))
    verdict = {} if cell.status in ("skipped", "failed") else {"status": "done" if scored == clips else "partial"}
    memory_mb = process_peak_mb()  # nothing was predicted that could have a peak of its own
    tally = {"num_clips": len(scored), "seconds": watch.seconds, "peak_memory_mb": memory_mb, "peak_is_own": False}
    into.write_cell(cell.name, {**cell.record, **verdict, **tally})
    if tables:
        part = Part(0, tuple(scored), cell.fingerprint, {}, watch.seconds, memory_mb)
        into.write_part(cell.name, pa.concat_tables(tables), part)
