"""Why two stored numbers differ: whatever is stored and not the same, in sentences, and the paired
difference.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from geovp_benchmarks.analysis import intervals, statistics
from geovp_benchmarks.results import provenance
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.results.stored_facts import title
from geovp_classic import registry
from geovp_classic.errors import BadData

FRAMES = {
    "num_past": "frames seen",
    "num_future": "frames predicted",
    "size_px": "width and height in pixels",
    "stride": "frames between the starts of two clips",
    "split_hash": "hash of the split's frames",
}
OF_A_METRIC = {
    "asked": "settings",
    "definition": "definition",
    "unit": "unit",
    "higher_is_better": "direction",
    "unavailable": "unavailable because",
}
OF_A_METHOD = {
    "num_samples": "samples",
    "privileged_inputs": "privileged inputs",
    "status": "status",
    "num_clips": "clips scored",
}
MOST_CLIPS = 5


@dataclass(frozen=True)
class Side:
    """A method of a results folder."""

    results: Results
    method: Method

    @property
    def protocol(self) -> dict[str, Any]:
        """What the folder's rows share."""
        return self.results.protocol()


def pairs(a: Results, b: Results, row_a: str = "", row_b: str = "") -> list[tuple[Side, Side]]:
    """The rows to compare: those asked for, a row not given being called as the other, or all of
    the same name.
    """
    of_a, of_b = _rows(a), _rows(b)
    names = (
        [(row_a or row_b, row_b or row_a)]
        if row_a or row_b
        else [(name, name) for name in of_a if name in of_b]
    )
    if not names:
        raise BadData(
            f"no method is in both: {', '.join(of_a)}; and {', '.join(of_b)}: name them as "
            "DIR:METHOD"
        )
    return [
        (Side(a, _method(a, of_a, one)), Side(b, _method(b, of_b, other))) for one, other in names
    ]


def shared(a: Side, b: Side) -> Iterator[str]:
    """What differs between the folders."""
    ids = provenance.protocol_id(a.protocol), provenance.protocol_id(b.protocol)
    if ids[0] != ids[1]:
        yield f"Protocol ids: {ids[0]} in A, {ids[1]} in B."
    datasets = (
        {"name": side.protocol["dataset_name"], **side.protocol["dataset"]} for side in (a, b)
    )
    yield from _differences("Data set", *datasets)
    yield from _clips(a.protocol["clips"], b.protocol["clips"])
    numbers = ({words: side.protocol.get(key) for key, words in FRAMES.items()} for side in (a, b))
    yield from _differences("Protocol", *numbers)
    yield from _metrics(a.protocol["metrics"], b.protocol["metrics"])
    yield from _differences(
        "Library versions", a.protocol.get("versions", {}), b.protocol.get("versions", {})
    )


def own(a: Side, b: Side) -> Iterator[str]:
    """What differs between the rows."""
    yield from _differences(
        "Method",
        *(
            {words: getattr(side.method, key) for key, words in OF_A_METHOD.items()}
            for side in (a, b)
        ),
    )
    yield from _differences("Component", a.method.components, b.method.components)
    yield from _differences(
        "Weights", *(dict.fromkeys(side.method.record.get("about", ()), "used") for side in (a, b))
    )
    yield from _differences("Code", *({"version": _code(side)} for side in (a, b)))
    # the metrics with all their settings, as rows were scored with them; none of rows scored again
    resolved = [
        {
            name: spec
            for part in side.results.parts(side.method.name)
            for name, spec in part.metrics.items()
        }
        for side in (a, b)
    ]
    both = resolved[0].keys() & resolved[1].keys()
    yield from _differences(
        "Metric", *({name: one[name] for name in sorted(both)} for one in resolved)
    )
    failed = [side.results.failures(side.method.name) for side in (a, b)]
    for name, one, other in (("A", failed[0], failed[1]), ("B", failed[1], failed[0])):
        only = sorted(one.keys() - other.keys())
        if only:
            reasons = "; ".join(dict.fromkeys(one[clip] for clip in only))
            yield (
                f"Only {name} could not predict {_named(only)}, scored as copies of the last "
                f"frame: {reasons}."
            )


def differences(a: Side, b: Side) -> Iterator[str]:
    """Each metric's means as in tables, and the paired difference over common clips with its
    interval, if any.
    """
    rows = [side.results.scores(side.method.name) for side in (a, b)]
    samples = " (means over samples)" if max(a.method.num_samples, b.method.num_samples) > 1 else ""
    for metric in (name for name in a.protocol["metrics"] if name in b.protocol["metrics"]):
        means = []
        for table in rows:
            cube = statistics.cube(table, metric)
            steps = statistics.over_steps(statistics.mean_of_samples(cube, True))
            means.append(
                {
                    clip: value
                    for clip, value in zip(cube.clips, steps.tolist(), strict=True)
                    if np.isfinite(value)
                }
            )
        if not all(means):
            continue
        common = [clip for clip in a.protocol["clips"] if clip in means[0] and clip in means[1]]
        one, other = (f"{np.mean([*each.values()]):.4f} on {len(each)} clips" for each in means)
        if means[0] == means[1]:
            yield f"{title(metric)}{samples}: identical, {one}."
            continue
        text = f"{title(metric)}{samples}: A {one}, B {other}"
        if common:
            gaps = np.array([means[0][clip] - means[1][clip] for clip in common])
            found = intervals.interval(gaps, intervals.sequences_of(common))
            limits = f" [{found.low:+.4f}, {found.high:+.4f}]" if np.isfinite(found.low) else ""
            text += f"; A - B on the {len(common)} common clips: {found.mean:+.4f}{limits}"
        yield f"{text}."


def _rows(results: Results) -> dict[str, Method]:
    return {method.label: method for method in results.methods()}


def _method(results: Results, methods: Mapping[str, Method], name: str) -> Method:
    found = methods.get(name) or next(
        (method for method in methods.values() if method.name == name), None
    )
    if found is None:
        raise BadData(f"{results.root} has no method {name!r}{registry.nearest(name, methods)}")
    return found


def _code(side: Side) -> str:
    """The versions of the code that the row's clips were computed with."""
    codes = {part.code for part in side.results.parts(side.method.name)} or {
        str(side.method.record.get("code", ""))
    }
    return " and ".join(sorted(code or "not stored" for code in codes))


def _clips(a: list[str], b: list[str]) -> Iterator[str]:
    only = [[clip for clip in one if clip not in other] for one, other in ((a, b), (b, a))]
    if any(only):
        count = f"A has {len(a)}, B {len(b)}, {len(a) - len(only[0])} in common"
        tails = [
            f"only in {name}: {_named(clips)}"
            for name, clips in zip("AB", only, strict=True)
            if clips
        ]
        yield f"Clips: {'; '.join([count, *tails])}."


def _metrics(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[str]:
    for name, one, other in (("A", a, b), ("B", b, a)):
        if only := [metric for metric in one if metric not in other]:
            yield f"Metrics only in {name}: {', '.join(only)}."
    for metric in (metric for metric in a if metric in b):
        facts = (
            {words: about.get(key) for key, words in OF_A_METRIC.items()}
            for about in (a[metric], b[metric])
        )
        yield from _differences(f"Metric {metric}", *facts)


def _differences(what: str, a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[str]:
    flat_a, flat_b = dict(flat(a)), dict(flat(b))
    for key in dict.fromkeys([*flat_a, *flat_b]):
        one, other = flat_a.get(key), flat_b.get(key)
        if one != other:
            yield f"{what}: {key}: {_words(one)} in A, {_words(other)} in B."


def flat(settings: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Nested settings as values by dotted keys."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _words(value: Any) -> str:
    if value is None or value == "" or value == []:
        return "nothing"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _named(clips: Iterable[str]) -> str:
    clips = list(clips)
    return ", ".join(clips[:MOST_CLIPS]) + (
        f" and {len(clips) - MOST_CLIPS} more" if len(clips) > MOST_CLIPS else ""
    )
