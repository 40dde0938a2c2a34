"""Why the numbers of two results folders, or of two methods, differ."""

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.results.stored_facts import title
from geovp_benchmarks.statistics.intervals import Intervals
from geovp_benchmarks.tables.tables import method_scores
from geovp_classic.errors import BadData


def compare(a: Results, b: Results) -> Iterator[str]:
    """Yield what differs between two folders, then between methods, and their paired differences.

    Without a selected method, all methods with the same label are compared.
    """
    selected = a.selected or b.selected
    pairs = [*zip(selected, b.selected or selected, strict=True)]
    if not pairs:
        labels = [method.label for method in b.methods()]
        pairs = [(method.label, method.label) for method in a.methods() if method.label in labels]
    if not pairs:
        raise BadData(f"{a.root} and {b.root} share no method: name them as DIR:METHOD")
    common = {*a.protocol()["clips"]} & {*b.protocol()["clips"]}
    shared = [*_clips(a, b), *_differences(_protocol(a, common), _protocol(b, common))]
    yield from shared
    for name, other_name in pairs:
        side, other = a.select(name), b.select(other_name)
        yield f"\n{name}" if name == other_name else f"\n{name} (A), {other_name} (B)"
        lines = list(_differences(_facts(side), _facts(other)))
        yield from lines if lines or shared else ["Nothing differs that is stored."]
        yield from _paired_differences(side, other)


def _clips(*sides: Results) -> Iterator[str]:
    """Yield a line if the folders do not have the same clips."""
    clips, clips_b = ({*side.protocol()["clips"]} for side in sides)
    if clips != clips_b:
        yield f"clips: {len(clips - clips_b)} in A only, {len(clips_b - clips)} in B only."


def _protocol(side: Results, common: set[str]) -> dict[str, Any]:
    """Return what a folder stores about all methods and the common clips."""
    skipped = ("name", "methods", "fingerprint", "clips")
    protocol = {key: value for key, value in side.protocol().items() if key not in skipped}
    digests = protocol.get("digests", {})
    return {**protocol, "digests": {clip: digests[clip] for clip in digests if clip in common}}


def _facts(results: Results) -> dict[str, Any]:
    """Return what is stored about the selected method and decides its scores."""
    (method,) = results.methods()
    scored = method.scored.values()
    return {
        "status": method.status,
        "samples": method.num_samples,
        "privileged inputs": method.privileged_inputs,
        "components": method.components,
        "weights": method.about,
        "code": sorted({record.code for record in scored}),
        "metrics": {name: spec for record in scored for name, spec in record.metrics.items()},
        "failures, scored as copies of the last frame": {
            clip: failure.reason for clip, failure in method.scored.failures.items()
        },
    }


def _differences(
    a: Mapping[str, Any], b: Mapping[str, Any], prefix: str = "", max_lines: int = 20
) -> Iterator[str]:
    """Yield what differs between nested settings, by dotted keys."""
    different = [key for key in {**a, **b} if a.get(key) != b.get(key)]
    for key in different[:max_lines]:
        value, other = a.get(key), b.get(key)
        if isinstance(value, Mapping) and isinstance(other, Mapping):
            yield from _differences(value, other, f"{prefix}{key}.")
        else:
            texts = [json.dumps(side, ensure_ascii=False) for side in (value, other)]
            yield f"{prefix}{key}: {texts[0]} in A, {texts[1]} in B."
    if len(different) > max_lines:
        yield f"{prefix}: {len(different) - max_lines} more differences."


def _paired_differences(*sides: Results) -> Iterator[str]:
    """Yield the means of each metric, and the mean difference over common clips."""
    clips, clips_b = (side.protocol()["clips"] for side in sides)
    common = [clip for clip in clips if clip in clips_b]
    rows, rows_b = ([names.index(clip) for clip in common] for names in (clips, clips_b))
    scores, scores_b = (method_scores(side, side.methods())[0].scores for side in sides)
    for key in (key for key in scores if key in scores_b and "@" not in key):
        gaps = scores[key].values[rows] - scores_b[key].values[rows_b]
        gap = Intervals().interval(gaps, common)
        interval = f" [{gap.low:+z.4g}, {gap.high:+z.4g}]" if math.isfinite(gap.low) else ""
        yield (
            f"{title(key)}: A {scores[key].mean:.4f} on {scores[key].clips} clips, "
            f"B {scores_b[key].mean:.4f} on {scores_b[key].clips}; A - B on the {gap.clips} common "
            f"clips: {gap.mean:+z.4g}{interval}."
        )
