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


def merge(
    output: Results,
    inputs: Sequence[Results],
    *,
    any_version: bool = False,
    is_compact: bool = False,
) -> None:
    """Write the clips, methods, scores and kept files of all inputs into one folder.

    A compact folder has one score file for all methods, and no kept files.

    Raise BadData if they disagree in the protocol, in versions of libraries, in the settings of a
    method or in the content of a clip. Of scores of one clip, the newest count.
    """
    protocol, methods = _merged_records(inputs, any_version)
    output.write_protocol({**protocol, "methods": [*methods]})
    for method in methods.values():
        output.write_method(method)
    patterns = ["*/scores/part-*.parquet", "scores/part-*.parquet"]
    if not is_compact:
        patterns += ["*/predictions/[!.]*", "clips/[!.]*"]
    for results in inputs:
        for pattern in patterns:
            _copy(results.root, output.root, pattern)
    output.merge(methods.values())
    if is_compact:
        output.compact()


def _merged_records(
    inputs: Sequence[Results], any_version: bool
) -> tuple[dict[str, Any], dict[str, Method]]:
    """Return the protocol and the methods of all inputs, of which one is in memory at a time."""
    first, *others = inputs
    protocol, methods = {**first.protocol()}, dict[str, Method]()
    _add_methods(methods, first)
    for results in others:
        _check(first.root, protocol, results, any_version)
        _add_clips(protocol, results.protocol())
        _add_methods(methods, results)
        results.memory.clear()
    return {**protocol, "id": protocol_id(protocol)}, {
        name: method.model_copy(update={"status": "done"} if method.status == "partial" else {})
        for name, method in methods.items()
    }


def _check(root: Path, protocol: Mapping[str, Any], results: Results, any_version: bool) -> None:
    """Raise BadData if a folder has another protocol, other versions or other data."""
    other, places = results.protocol(), f"{root} and {results.root}"
    for key, value in _comparable(protocol).items():
        if _comparable(other).get(key) != value:
            raise BadData(
                f"{places} differ in the protocol's {key}: merge results of one matrix alone"
            )
    for library, version in protocol["versions"].items():
        if other["versions"].get(library) != version and not any_version:
            raise BadData(
                f"{places} were computed with {library} {version} and "
                f"{other['versions'].get(library)}: recompute one of them, or give --any-version"
            )
    digests, other_digests = protocol.get("digests", {}), other.get("digests", {})
    for clip, digest in other_digests.items() if other_digests != digests else ():
        if digests.get(clip, digest) != digest:
            raise BadData(
                f"{places} have other frames of clip {clip}: merge results of the same data"
            )


def _add_clips(protocol: dict[str, Any], other: Mapping[str, Any]) -> None:
    """Add the clips and sequences of another folder to a protocol."""
    if other["clips"] != protocol["clips"]:
        protocol["clips"] = [*dict.fromkeys([*protocol["clips"], *other["clips"]])]
        protocol["digests"] = other.get("digests", {}) | protocol.get("digests", {})
    if other["dataset"] != protocol["dataset"]:
        datasets = (protocol["dataset"], other["dataset"])
        names = dict.fromkeys(name for each in datasets for name in each.get("sequences") or ())
        protocol["dataset"] = {**protocol["dataset"], "sequences": [*names]}


def _comparable(protocol: Mapping[str, Any]) -> dict[str, Any]:
    """Return what must agree between the protocols of merged folders."""
    facts = {key: value for key, value in protocol.items() if key not in OF_CLIPS}
    dataset = protocol["dataset"].items()
    return facts | {"dataset": {key: value for key, value in dataset if key not in OF_DATA}}


def _add_methods(methods: dict[str, Method], results: Results) -> None:
    """Add the methods of a folder; of one that could not be built everywhere, where it could."""
    for path in results.damaged_files():
        raise BadData(f"{path} is damaged: `geovp run` in that folder computes it again")
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


def _copy(source: Path, target: Path, pattern: str) -> None:
    for path in source.glob(pattern):
        place = target / path.relative_to(source)
        place.parent.mkdir(parents=True, exist_ok=True)
        if not place.exists():
            shutil.copyfile(path, place)
