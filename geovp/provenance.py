"""What a result depends on: versions of packages, and the source files of components."""

import ast
import contextlib
import dataclasses
import functools
import hashlib
import importlib.util
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
    """Return a short hash of the source files that components and their users depend on."""
    used = sources(components, users)
    content = b"".join(name.encode() + used[name] for name in sorted(used))
    return hashlib.sha256(content).hexdigest()[:12]


def sources(components: Iterable[object], users: Iterable[str] = ()) -> dict[str, bytes]:
    """Return the hash of the source file of each module that components and their users depend on.

    These are their modules, and what these import from the components' packages and from
    geovp_classic. Libraries do not count; `versions` has theirs.
    """
    modules = {type(component).__module__ for component in nested(components)} - {"builtins"}
    packages = {module.partition(".")[0] for module in modules} | {"geovp_classic"}
    packages -= {user.partition(".")[0] for user in users}
    waiting, used = [*modules, *users], dict[str, bytes]()
    while waiting:
        module = waiting.pop()
        if module not in used:
            used[module], imported = _source(module)
            waiting += [name for name in imported if name.partition(".")[0] in packages]
    return used


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
def _source(module: str) -> tuple[bytes, frozenset[str]]:
    """Return the hash of a module's source file, and the names of the modules that it imports."""
    spec = importlib.util.find_spec(module) if module in sys.modules or "." in module else None
    if spec is None or not spec.origin or not spec.origin.endswith(".py"):
        return b"", frozenset()
    source = Path(spec.origin).read_bytes()
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            package = importlib.util.resolve_name(
                "." * node.level + (node.module or ""), spec.parent
            )
            names |= {package, *(f"{package}.{alias.name}" for alias in node.names)}
    return hashlib.sha256(source).digest(), frozenset(filter(_is_module, names))


@functools.cache
def _is_module(name: str) -> bool:
    """Return whether a name is that of a module, and not of something in it."""
    with contextlib.suppress(ImportError, ValueError):
        return importlib.util.find_spec(name) is not None
    return False
