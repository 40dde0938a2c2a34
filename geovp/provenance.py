"""What a result depends on: versions of packages, and the source files of components."""

import contextlib
import dataclasses
import functools
import hashlib
import importlib
import platform
import sys
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path


def versions() -> dict[str, str]:
    """Return the versions of the packages that numbers depend on, and the kind of processor."""
    from llvmlite.binding import get_host_cpu_name

    installed = {"python": platform.python_version(), "processor": get_host_cpu_name()}
    packages = "geovp numpy scipy numba opencv-contrib-python-headless open3d pycolmap"
    for package in [*packages.split(), "torch"]:
        with contextlib.suppress(metadata.PackageNotFoundError):
            installed[package] = metadata.version(package)
    return installed


def code_hash(components: Iterable[object], users: Iterable[str] = ()) -> str:
    """Return a short hash of the source files of the components' packages.

    `users` are the modules that use them. Libraries do not count; `versions` has theirs.
    """
    modules = {"geovp_classic", *users}
    for component in nested(components):
        package = type(component).__module__.partition(".")[0]
        if package in sys.modules and package != "builtins":
            modules.add(package)
    hashes = (name.encode() + _source_hash(name) for name in sorted(modules))
    return hashlib.sha256(b"".join(hashes)).hexdigest()[:12]


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
