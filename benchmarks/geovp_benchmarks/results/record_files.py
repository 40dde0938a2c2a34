"""Schemas of protocol.json, method.json and datasets.json."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from geovp_classic import files
from geovp_classic.errors import BadData

TEXTS, NUMBER = "a list of texts", (int, float)
PROTOCOL: dict[str, Any] = {
    "methods": TEXTS,
    "clips": TEXTS,
    "name": str,
    "metrics": dict,
    "num_past": int,
}
PROTOCOL |= {
    "num_future": int,
    "stride": int,
    "size_px": list,
    "dataset": dict,
    "versions": dict,
    "fingerprint": str,
}
PROTOCOL |= {"id": str, "dataset_name": str, "split_hash": str}
METHOD: dict[str, Any] = {
    "label": str,
    "kind": str,
    "status": str,
    "privileged_inputs": TEXTS,
    "num_samples": int,
}
METHOD |= {"num_clips": int, "seconds": dict, "fingerprint": str, "components": dict}
METHOD_MAY_HAVE: dict[str, Any] = {
    "reason": str,
    "num_failed": int,
    "num_outdated": int,
    "code": str,
}
METHOD_MAY_HAVE |= {"peak_memory_mb": NUMBER, "peak_is_own": bool}


@dataclass(frozen=True)
class Method:
    """One row of a table: a pose source with a renderer, or a whole predictor."""

    name: str  # of the folder: "gt-3d--ground-far-plane", "copy-last"
    record: Mapping[
        str, Any
    ]  # all of method.json; also traceback, code, peak_memory_mb, peak_is_own
    label: str  # for people: "gt-3d + ground-far-plane"
    kind: str  # "geometric" or "predictor"
    status: str  # "done", "partial", "skipped" or "failed"
    privileged_inputs: Sequence[str]  # names of the PrivilegedInput members that its components use
    num_samples: int  # S, how many futures it was asked for
    num_clips: int  # how many clips have rows
    seconds: Mapping[
        str, float
    ]  # per stage, summed over its clips: motion, reconstruct, view (or predict), metrics
    fingerprint: (
        str  # a hash of the resolved components and the protocol: parts with another one are stale
    )
    components: Mapping[
        str, Any
    ]  # resolved, every field spelled out: pose_source and renderer, or predictor
    pose_source: str | None = None  # the matrix file's names; None for a whole predictor
    renderer: str | None = None
    reason: str = ""  # why it was skipped or failed
    num_failed: int = (
        0  # clips that it could not predict: their rows are those of a copy of the last frame
    )
    num_outdated: int = 0  # clips whose rows other code than the last run's computed

    @classmethod
    def of(cls, name: str, record: Mapping[str, Any]) -> Self:
        """The method of a method.json."""
        own = {field.name for field in dataclasses.fields(cls)} & record.keys()
        return cls(name=name, record=record, **{key: record[key] for key in own})


class Record(dict[str, Any]):
    """A JSON object whose missing keys are named, with their file, when they are asked for."""

    def __init__(self, path: Path, content: Mapping[str, Any]) -> None:
        super().__init__(content)
        self.path = path

    def __missing__(self, key: str) -> Any:
        raise BadData(f"{self.path} has no {key!r}: restore it, or remove it and run again")


def protocol(path: Path) -> dict[str, Any]:
    """The content of a protocol.json."""
    if not path.exists():
        raise BadData(
            f"{path.parent} has no {path.name}: not a results folder: give one that `geovp run` "
            "wrote"
        )
    content = _read(path, {"methods": TEXTS}, PROTOCOL)
    for name in content["methods"]:
        files.check_name(name, f"{path}: the method")
    return content


def method(path: Path) -> Method:
    """The method of a method.json."""
    return Method.of(path.parent.name, _read(path, METHOD, METHOD_MAY_HAVE))


def labels(path: Path) -> list[str]:
    """The labels in a datasets.json."""
    found: list[str] = _read(path, {"datasets": TEXTS}, {})["datasets"]
    for label in found:
        files.check_name(label, f"{path}: the data set")
    return found


def _read(path: Path, needed: Mapping[str, Any], known: Mapping[str, Any]) -> Record:
    content = Record(path, files.read_json(path))
    for key, kind in {**known, **needed}.items():
        if key in needed or key in content:
            _check(path, key, content[key], kind)
    return content


def _check(path: Path, key: str, value: Any, kind: Any) -> None:
    if kind == TEXTS:
        right = isinstance(value, list) and all(isinstance(each, str) for each in value)
    else:
        right = isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
    if not right:
        expected = kind if isinstance(kind, str) else getattr(kind, "__name__", "a number")
        raise BadData(
            f"{path}: {key} is {str(value)[:60]!r}, expected {expected}: restore it, or remove "
            "it, run again"
        )
