"""Components of a matrix file: built or a reason why not, and a hash of their source files."""

import contextlib
import dataclasses
import functools
import hashlib
import importlib
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.matrix.values import Spec
from geovp_benchmarks.results.score_files import Failure
from geovp_classic import registry
from geovp_classic.errors import GeovpError, Incompatible, MissingExtra
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.types import PrivilegedInput


def build(
    role: str, name: str, spec: Spec, try_out: Callable[[Any], object] = lambda component: None
) -> Any:
    """Build the component of an entry and try it; return a Failure if it cannot work here.

    Mistakes in the file are raised: an unknown name or field, or a value that its component
    refuses.
    """
    try:
        component = registry.build(role, spec, f"{role}.{name}")
        has_needs = isinstance(getattr(component, "needs", None), PrivilegedInput)
        if role in ("pose_sources", "renderers", "predictors") and not has_needs:
            raise TypeError(
                f"{name!r} does not say what it needs: give it `needs`, PrivilegedInput.NONE for "
                "the frames alone"
            )
        try_out(component)
    except Exception as error:
        if isinstance(error, GeovpError) and not isinstance(error, (Incompatible, MissingExtra)):
            raise
        return Failure.of(error)  # an error of a plug-in: its methods fail, the others go on
    return component


def build_method(matrix: Matrix, label: str) -> Any:
    """Build the predictor of a method; UnknownComponent names the nearest label."""
    selected = matrix.select(label)
    (method,) = selected.methods
    components = {
        role: registry.build(key[0], selected.specs[key], ".".join(key))
        for role, key in method.components.items()
    }
    return components.get("predictor") or GeometricPredictor(**components)


def on_device(device: str | None) -> contextlib.AbstractContextManager[None]:
    """Build networks for this device unless they name one; None keeps their defaults."""
    return registry.defaults() if device is None else registry.defaults(device=device)


def code_hash(components: Iterable[object]) -> str:
    """Return a short hash of the source files of the components' packages and of the harness.

    Libraries do not count; protocol.json has their versions.
    """
    harness = "geovp_benchmarks"
    modules = {"geovp_classic", f"{harness}.running.task", f"{harness}.running.scoring"}
    for component in nested(components):
        package = type(component).__module__.partition(".")[0]
        if package in sys.modules and package not in ("builtins", harness):
            modules.add(package)
    hashes = (name.encode() + _source_hash(name) for name in sorted(modules))
    return hashlib.sha256(b"".join(hashes)).hexdigest()[:12]


def weights_of(components: Iterable[object]) -> list[str]:
    """Return the notes on weights that components and nested ones have as `weights_note`."""
    notes = (getattr(component, "weights_note", "") for component in nested(components))
    return [str(note) for note in dict.fromkeys(notes) if note]


def nested(components: Iterable[object]) -> Iterator[object]:
    """Yield the components and the components nested in them."""
    for component in components:
        yield component
        if dataclasses.is_dataclass(component):
            for field in dataclasses.fields(component):
                value = getattr(component, field.name)
                inner = value if isinstance(value, tuple) else (value,)
                yield from nested(each for each in inner if dataclasses.is_dataclass(each))


@functools.cache
def _source_hash(module: str) -> bytes:
    """Return the hash of the source files of a module or package."""
    file = Path(getattr(importlib.import_module(module), "__file__", None) or "")
    files = file.parent.rglob("*.py") if file.name == "__init__.py" else [file]
    content = (path.name.encode() + path.read_bytes() for path in sorted(files) if path.is_file())
    return hashlib.sha256(b"".join(content)).digest()
