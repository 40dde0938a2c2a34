"""The components of a matrix file: built or a reason why not, and a hash of the sources that
compute with them.
"""

import dataclasses
import functools
import hashlib
import sys
import traceback
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from geovp_benchmarks.matrix.matrix_values import Spec
from geovp_classic import registry
from geovp_classic.errors import BadData, GeovpError, Incompatible, MissingExtra
from geovp_classic.types import PrivilegedInput

ALWAYS_HASHED = (
    "geovp_classic",
    "geovp_benchmarks.running.built_matrix",
    "geovp_benchmarks.running.scoring",
    "geovp_benchmarks.running.metric_set",
)
DIGITS = 12
PREDICTING = ("pose_sources", "renderers", "predictors")


@dataclass(frozen=True)
class Failure:
    """The reason why a cell, component or metric is skipped or failed."""

    status: str  # "skipped" or "failed"
    reason: str
    traceback: str = ""

    @classmethod
    def of(cls, error: Exception) -> Self:
        """Skipped when components do not suit each other or something is not installed, failed
        otherwise.
        """
        if isinstance(error, (Incompatible, MissingExtra)):
            return cls("skipped", str(error))
        trace = "".join(traceback.format_exception(error))
        reason = str(error) if isinstance(error, BadData) else f"{type(error).__name__}: {error}"
        return cls("failed", reason.strip().partition("\n")[0], trace)


def build(role: str, name: str, spec: Spec) -> Any:
    """The component of a matrix file's entry, or a Failure when it cannot work here or is not what
    it should be.

    What the file itself says wrong is raised: an unknown name or field, a value that its component
    refuses.
    """
    try:
        component = registry.build(role, spec, f"{role}.{name}")
        if role in PREDICTING and not isinstance(
            getattr(component, "needs", None), PrivilegedInput
        ):
            raise TypeError(
                f"{name!r} does not say what it needs: give it `needs`, PrivilegedInput.NONE "
                "for the frames alone"
            )
    except (Incompatible, MissingExtra) as error:
        return Failure.of(error)
    except GeovpError:
        raise
    except Exception as error:  # a plug-in's own: its rows fail, the others go on
        return Failure.of(error)
    return component


def on_device(device: str | None) -> AbstractContextManager[None]:
    """Within it, networks are built for this device unless they name one themselves; None: for
    their own default.
    """
    return registry.defaults() if device is None else registry.defaults(device=device)


def code_hash(components: Iterable[object]) -> str:
    """A short hash: another one when a source file of these components' packages, or of the suite,
    has changed.

    Libraries don't count; protocol.json has their versions.
    """
    packages = {
        type(each).__module__.partition(".")[0]
        for component in components
        for each in nested(component)
    }
    total = hashlib.sha256()
    for name in sorted(
        {*ALWAYS_HASHED, *packages & sys.modules.keys()} - {"builtins", "geovp_benchmarks"}
    ):
        total.update(name.encode() + _source_hash(name))
    return total.hexdigest()[:DIGITS]


def weights_of(components: Iterable[object]) -> list[str]:
    """What trained components, nested ones too, say of their weights in an optional property
    `weights_note`.
    """
    notes = [
        getattr(part, "weights_note", "") for component in components for part in nested(component)
    ]
    return [str(note) for note in dict.fromkeys(notes) if note]


def nested(component: object) -> Iterator[object]:
    """The component and the components nested in it."""
    yield component
    if dataclasses.is_dataclass(component):
        values = [getattr(component, field.name) for field in dataclasses.fields(component)]
        parts = [
            part for value in values for part in (value if isinstance(value, tuple) else (value,))
        ]
        for part in filter(dataclasses.is_dataclass, parts):
            yield from nested(part)


@functools.cache
def _source_hash(module: str) -> bytes:
    """The hash of the sources of a module or package."""
    __import__(module)
    loaded = sys.modules[module]
    folders = [Path(folder) for folder in getattr(loaded, "__path__", [])]
    files = [
        (path.relative_to(folder), path)
        for folder in folders
        for path in sorted(folder.rglob("*.py"))
    ]
    single = getattr(loaded, "__file__", None)  # an interactive session has none
    if not folders and single:
        files = [(Path(Path(single).name), Path(single))]
    total = hashlib.sha256()
    for name, path in files:
        total.update(name.as_posix().encode() + hashlib.sha256(path.read_bytes()).digest())
    return total.digest()
