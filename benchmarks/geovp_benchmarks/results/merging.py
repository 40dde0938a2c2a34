"""Merging of results folders: shards of one matrix, or methods that other machines computed."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from geovp_benchmarks.results.provenance import PATHS, protocol_id
from geovp_benchmarks.results.records import Method
from geovp_benchmarks.results.store import Results
from geovp_classic.errors import BadData

# What may differ between folders of one matrix: data at other places, or of other sequences.
OF_CLIPS = {"clips", "digests", "methods", "dataset", "split_hash", "id", "versions", "name"}
OF_DATA = {*PATHS, "sequences", "split", "num_clips", "with_full", "with_right"}


def merge(output: Results, inputs: Sequence[Results], *, any_version: bool = False) -> None:
    """Write the clips, methods, scores and kept files of all inputs into one folder.

    Raise BadData if they disagree in the protocol, in versions of libraries, in the settings of a
    method or in the content of a clip. Of scores of one clip, the newest count.
    """
    protocols = {results.root: results.protocol() for results in inputs}
    protocol = _merged_protocol(protocols, any_version)
    methods = _merged_methods(inputs)
    output.write_protocol({**protocol, "methods": [*methods]})
    for method in methods.values():
        output.write_method(method)
    for results in inputs:
        for pattern in ("*/scores/part-*.parquet", "scores/part-*.parquet", "*/predictions/[!.]*"):
            _copy(results.root, output.root, pattern)
        _copy(results.root, output.root, "clips/[!.]*")
    output.merge(methods.values())


def _merged_protocol(protocols: Mapping[Path, dict[str, Any]], any_version: bool) -> dict[str, Any]:
    (first_root, first), *others = protocols.items()
    merged = {**first, "clips": [*first["clips"]], "digests": dict(first.get("digests", {}))}
    for root, other in others:
        places = f"{first_root} and {root}"
        for key, value in _comparable(first).items():
            if _comparable(other).get(key) != value:
                raise BadData(
                    f"{places} differ in the protocol's {key}: merge results of one matrix alone"
                )
        for library, version in first["versions"].items():
            if other["versions"].get(library) != version and not any_version:
                raise BadData(
                    f"{places} were computed with {library} {version} and "
                    f"{other['versions'].get(library)}: recompute one of them, or give "
                    "--any-version"
                )
        for clip, digest in other.get("digests", {}).items():
            if merged["digests"].setdefault(clip, digest) != digest:
                raise BadData(
                    f"{places} have other frames of clip {clip}: merge results of the same data"
                )
        if other["dataset"] != first["dataset"]:  # of other sequences
            names = dict.fromkeys(
                name for each in (merged, other) for name in each["dataset"].get("sequences") or ()
            )
            merged["dataset"] = {**merged["dataset"], "sequences": [*names]}
        before = set(merged["clips"])
        merged["clips"] += [clip for clip in other["clips"] if clip not in before]
    return {**merged, "id": protocol_id(merged)}


def _comparable(protocol: Mapping[str, Any]) -> dict[str, Any]:
    """Return what must agree between the protocols of merged folders."""
    facts = {key: value for key, value in protocol.items() if key not in OF_CLIPS}
    dataset = protocol["dataset"].items()
    return facts | {"dataset": {key: value for key, value in dataset if key not in OF_DATA}}


def _merged_methods(inputs: Sequence[Results]) -> dict[str, Method]:
    """Return the methods by name; of one that could not be built everywhere, where it could."""
    methods: dict[str, Method] = {}
    for results in inputs:
        for name, method in results.by_name().items():
            before = methods.get(name)
            if before is None or not before.fingerprint:
                methods[name] = method
            elif method.fingerprint and method.fingerprint != before.fingerprint:
                raise BadData(
                    f"{results.root} has {method.label!r} with other settings: rename it in one of "
                    "the matrix files"
                )
            elif before.status == "failed" or method.num_clips > before.num_clips:
                methods[name] = method
    return {
        name: method.model_copy(update={"status": "done"} if method.status == "partial" else {})
        for name, method in methods.items()
    }


def _copy(source: Path, target: Path, pattern: str) -> None:
    for path in source.glob(pattern):
        place = target / path.relative_to(source)
        place.parent.mkdir(parents=True, exist_ok=True)
        if not place.exists():
            shutil.copyfile(path, place)
