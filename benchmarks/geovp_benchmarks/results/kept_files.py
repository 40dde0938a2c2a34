"""Kept clips and predictions: npz files with the fields of `Clip` and `Prediction` by their path,
such as "motion.past.world_from_cam".
"""

import hashlib
import io
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar
from urllib.parse import quote, unquote

import numpy as np

from geovp_classic import files
from geovp_classic.atomic import write_bytes
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, Intrinsics, Motion, Prediction, Trajectory

Stored = TypeVar("Stored", Clip, Prediction)
NESTED = {"intrinsics": Intrinsics, "trajectory": Trajectory, "motion": Motion, "past": Trajectory}


@dataclass(frozen=True)
class KeptFiles(Generic[Stored]):
    """Kept clips, or predictions of a method, of one fingerprint."""

    folder: Path
    fingerprint: str
    kind: type[Stored]
    digests: Mapping[str, str] = field(default_factory=dict)  # of the content of clips

    @property
    def names(self) -> list[str]:
        """Return the names of the clips that have a file."""
        names = {
            path: unquote(path.stem.rpartition(".")[0]) for path in self.folder.glob("[!.]*.npz")
        }
        return sorted(name for path, name in names.items() if path == self.path(name))

    def path(self, clip: str) -> Path:
        """Return the file of a clip, from whose name that of the clip can be recovered."""
        key = self.fingerprint
        if digest := self.digests.get(clip):
            key = hashlib.sha256(f"{key}{digest}".encode()).hexdigest()
        return self.folder / f"{quote(clip, safe='+@=, ')}.{key[:8]}.npz"

    def write(self, clip: str, value: Stored) -> None:
        """Write all fields but those that are None; a clip without its full and right views."""
        stream = io.BytesIO()  # a zip file raises a second error when it is closed on a full disk
        np.savez_compressed(stream, **dict(_flattened(value)))
        write_bytes(self.path(clip), stream.getvalue())

    def read(self, clip: str) -> Stored:
        """Return a clip or prediction; raise BadData for a missing file or other arrays."""
        path = self.path(clip)
        arrays = files.read_npz(path)
        with files.checked(f"{path} holds another {self.kind.__name__}", "remove it"):
            value: Stored = _built(self.kind, arrays)
        return value


def is_whole(path: Path) -> bool:
    """Return whether a file is as it was written."""
    with suppress(BadData):
        files.read_npz(path)
        return True
    return False


def _flattened(value: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path and value of each field."""
    for each in fields(value):
        item = getattr(value, each.name)
        if is_dataclass(item):
            if each.name in NESTED:  # not the full and right views of a clip
                yield from _flattened(item, f"{prefix}{each.name}.")
        elif item is not None:
            yield prefix + each.name, item


def _built(kind: Any, arrays: Mapping[str, Any]) -> Any:
    """Return a dataclass from the arrays of its fields and of nested ones."""
    values: dict[str, Any] = {}
    inner: dict[str, dict[str, Any]] = {}
    for path, array in arrays.items():
        name, _, rest = path.partition(".")
        if rest:
            inner.setdefault(name, {})[rest] = array
        else:
            values[name] = array if array.ndim else array.item()
    values |= {name: _built(NESTED[name], nested) for name, nested in inner.items()}
    return kind(**values)
