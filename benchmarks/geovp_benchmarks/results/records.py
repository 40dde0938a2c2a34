"""Records of results in JSON: protocol.json and method.json."""

import functools
import json
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, InstanceOf
from typing_extensions import TypedDict

from geovp_benchmarks.results.score_files import NewestRecords
from geovp_benchmarks.validation import validated
from geovp_classic import files
from geovp_classic.errors import BadData

Name = Annotated[str, Field(pattern=r"^[\w+=,][\w+=,.-]*$")]  # of a folder


class Protocol(TypedDict):
    """What all methods share."""

    __pydantic_config__ = ConfigDict(strict=True, extra="allow")  # type: ignore[misc]

    name: str
    methods: list[Name]  # in the order of the matrix file
    clips: list[str]  # in order
    # digests: dict[str, str], by clip; missing in results of earlier versions
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
    """A pose source with a renderer, or a whole predictor, before and after it was scored."""

    model_config = ConfigDict(strict=True, frozen=True)

    name: str  # of the folder: "gt-3d--ground-far-plane", "copy-last"
    label: str  # for people: "gt-3d + ground-far-plane"
    num_samples: int  # S, predicted futures
    status: str = "done"  # or "partial", "skipped", "failed"
    privileged_inputs: list[str] = []  # names of the members of PrivilegedInput
    # hash of components and protocol, "" if they cannot be built: scores with another do not count
    fingerprint: str = ""
    components: dict[str, Any] = {}  # pose_source and renderer, or predictor, with every field
    pose_source: str | None = None  # the matrix file's names; None for a whole predictor
    renderer: str | None = None
    reason: str = ""  # why it was skipped or failed
    traceback: str = ""
    code: str = ""  # hash of the sources
    about: list[str] = []  # weights of its networks
    asked: dict[str, Any] = {}  # settings in the matrix file, and the protocol's fingerprint

    # how the clips that have scores were scored; not stored here
    scored: InstanceOf[NewestRecords] = Field(default=NewestRecords(), exclude=True)

    @classmethod
    def of(cls, num_samples: int, source: str, renderer: str | None = None) -> Self:
        """Return a method of a matrix file: a predictor, or a pose source with a renderer."""
        if renderer is None:
            return cls(name=source, label=source, num_samples=num_samples)
        return cls(
            name=f"{source}--{renderer}",
            label=f"{source} + {renderer}",
            num_samples=num_samples,
            pose_source=source,
            renderer=renderer,
        )

    @property
    def entries(self) -> dict[str, tuple[str, str]]:
        """Return the role in the registry and the name in the matrix file of each component."""
        if self.pose_source is None or self.renderer is None:
            return {"predictor": ("predictors", self.name)}
        return {
            "pose_source": ("pose_sources", self.pose_source),
            "renderer": ("renderers", self.renderer),
        }

    @property
    def num_clips(self) -> int:
        """Return the number of clips that have scores."""
        return len(self.scored)

    @property
    def num_outdated(self) -> int:
        """Return the number of clips whose scores other code than the last run's computed.

        The code of clips that cannot be read, and of rescored predictions, is not known.
        """
        return sum(record.code not in ("", self.code) for record in self.scored.values())


def read_protocol(path: Path) -> dict[str, Any]:
    """Return the content of a protocol.json; raise BadData that names the file and the key."""
    try:
        return _protocol(files.read_text(path))
    except (BadData, ValueError, RecursionError):
        protocol: dict[str, Any] = read(path, Protocol)  # raises the error
        return protocol


@functools.lru_cache(maxsize=1)  # all shards of a matrix have one text, of 100,000 clips
def _protocol(text: str) -> dict[str, Any]:
    protocol: dict[str, Any] = validated(Protocol, json.loads(text))
    return protocol


def read(path: Path, kind: Any, **more: Any) -> Any:
    """Return the validated content of a file; raise BadData that names the file and the key."""
    content = files.read_json(path) | more
    try:
        return validated(kind, content)
    except BadData as problem:
        reason = str(problem).removesuffix(": add it")
        raise BadData(f"{path}: {reason}: restore it, or remove it and run again") from None
