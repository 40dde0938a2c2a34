"""Records of results in JSON: protocol.json, method.json and datasets.json."""

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict
from typing_extensions import TypedDict

from geovp_benchmarks.results.validation import validated
from geovp_classic import files
from geovp_classic.errors import BadData


class Protocol(TypedDict):
    """What all methods share."""

    __pydantic_config__ = ConfigDict(strict=True, extra="allow")  # type: ignore[misc]

    name: str
    methods: list[str]  # in the order of the matrix file
    clips: list[str]  # in order
    dataset: dict[str, Any]
    dataset_name: str
    split_hash: str
    num_past: int
    num_future: int
    size_px: list[int]  # width, height
    stride: int
    # by name: role ("frame" or "trajectory"), unit, higher_is_better (null: neither),
    # bounds [low, high] (null: none), unavailable (the reason, or null)
    metrics: dict[str, Any]
    versions: dict[str, str]
    fingerprint: str  # hash of what all scores depend on
    id: str  # short, in tables


class Method(BaseModel):
    """One line of a table: a pose source with a renderer, or a whole predictor."""

    model_config = ConfigDict(strict=True, frozen=True)

    name: str  # of the folder: "gt-3d--ground-far-plane", "copy-last"
    label: str  # for people: "gt-3d + ground-far-plane"
    kind: str  # "geometric" or "predictor"
    status: str  # "done", "partial", "skipped" or "failed"
    privileged_inputs: list[str]  # names of the members of PrivilegedInput
    num_samples: int  # S, predicted futures
    fingerprint: str  # hash of components and protocol: scores with another one do not count
    components: dict[str, Any]  # pose_source and renderer, or predictor, with every field
    pose_source: str | None = None  # the matrix file's names; None for a whole predictor
    renderer: str | None = None
    reason: str = ""  # why it was skipped or failed
    traceback: str = ""
    code: str = ""  # hash of the sources
    about: list[str] = []  # weights of its networks
    asked: dict[str, Any] = {}  # settings in the matrix file, and the protocol's fingerprint

    # sums over its scores, which are not stored
    num_clips: int = 0  # that have scores
    num_failed: int = 0  # clips scored as copies of the last frame
    num_outdated: int = 0  # clips whose scores other code than the last run's computed
    seconds: dict[str, float] = {}  # per stage
    peak_memory_mb: float = 0.0  # of its predictions; 0: unknown

    @property
    def record(self) -> dict[str, Any]:
        """Return the content of method.json, with the sums."""
        return self.model_dump(exclude={"name"})


def read_protocol(path: Path) -> dict[str, Any]:
    """Return the content of a protocol.json."""
    if not path.exists():
        raise BadData(
            f"{path.parent} has no {path.name}: not a results folder: give one that `geovp run` "
            "wrote"
        )
    protocol: dict[str, Any] = _validated(Protocol, files.read_json(path), path)
    for name in protocol["methods"]:
        files.check_name(name, f"{path}: the method")
    return protocol


def read_method(path: Path) -> Method:
    """Return the method of a method.json."""
    method: Method = _validated(Method, files.read_json(path) | {"name": path.parent.name}, path)
    return method


def read_labels(path: Path) -> list[str]:
    """Return the labels in a datasets.json."""
    labels: list[str] = _validated(list[str], files.read_json(path).get("datasets"), path)
    for label in labels:
        files.check_name(label, f"{path}: the data set")
    return labels


def _validated(kind: Any, content: Any, path: Path) -> Any:
    """Return the validated content of a file; raise BadData that names the file and the key."""
    try:
        return validated(kind, content)
    except BadData as problem:
        raise BadData(f"{path}: {problem}: restore it, or remove it and run again") from None
