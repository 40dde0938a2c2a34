"""Which code computed a row: a hash of the sources of its components' packages, and of what scores them."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

ALWAYS = ("geovp_classic", "benchmarks.workshop", "benchmarks.scoring", "benchmarks.measures")
DIGITS = 12


def code_of(components: Iterable[object]) -> str:
    """A short hash: another one when a source file of these components, or of the suite, has changed.

    Libraries don't count; protocol.json has their versions.
    """
    packages = {type(part).__module__.partition(".")[0] for component in components for part in _parts(component)}
    whole = hashlib.sha256()
    for name in sorted({*ALWAYS, *packages & sys.modules.keys()} - {"builtins", "benchmarks"}):
        whole.update(name.encode() + _digest(name))
    return whole.hexdigest()[:DIGITS]


def _parts(component: object) -> Iterator[object]:
    """The component and the ones that it is made of."""
    yield component
    if dataclasses.is_dataclass(component):
        values = [getattr(component, field.name) for field in dataclasses.fields(component)]
        for value in filter(dataclasses.is_dataclass, values):
            yield from _parts(value)


@functools.cache
def _digest(module: str) -> bytes:
    """Of the sources of a module, or of all modules of a package."""
    __import__(module)
    loaded = sys.modules[module]
    folders = [Path(folder) for folder in getattr(loaded, "__path__", [])]
    files = [(path.relative_to(folder), path) for folder in folders for path in sorted(folder.rglob("*.py"))]
    single = getattr(loaded, "__file__", None)  # what was typed in has none
    if not folders and single:
        files = [(Path(Path(single).name), Path(single))]
    whole = hashlib.sha256()
    for name, path in files:
        whole.update(name.as_posix().encode() + hashlib.sha256(path.read_bytes()).digest())
    return whole.digest()
