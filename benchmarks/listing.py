"""What is installed: every role and name, and what a name lacks, found out without importing anything heavy."""

from __future__ import annotations

import ast
import functools
import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from importlib.machinery import ModuleSpec
from pathlib import Path

from geovp_classic import registry


@dataclass(frozen=True)
class Listed:
    """One registered name."""

    role: str
    name: str
    package: str  # that brought it
    lacks: str  # "" when it can be loaded, as far as its imports tell

    @property
    def remark(self) -> str:
        """What to say beside the name."""
        if not self.lacks:
            return ""
        extra = registry.EXTRA_OF_MODULE.get(self.lacks.partition(".")[0])
        return f"(needs extra: {extra})" if extra else f"(needs {self.lacks})"


def listed(role: str) -> list[Listed]:
    """All names of a role, sorted."""
    registry.names(role)  # UnknownComponent with the nearest role
    found = []
    for entry in sorted(metadata.entry_points(group=f"geovp.{role}"), key=lambda entry: entry.name):
        package = entry.dist.name if entry.dist is not None else ""
        found.append(Listed(role, entry.name, package, _lacks(entry.value.partition(":")[0])))
    return found


def _lacks(module: str) -> str:
    """The first module that importing this one would ask for and not find, "" for none."""
    seen, waiting = {module}, [module]
    while waiting:
        wanted = _wanted(waiting.pop(0))
        if wanted is None:
            return module
        own, foreign = wanted
        lacking = next((root for root in foreign if not _exists(root)), None)
        if lacking is not None:
            return lacking
        waiting += [other for other in own if other not in seen]
        seen.update(own)
    return ""


@functools.cache
def _wanted(module: str) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """What a module imports: modules of its own package, and other packages; None when it is not there."""
    path = _source(module)
    if path is None:
        return None
    if path.suffix != ".py":  # compiled: says nothing
        return (), ()
    root = module.partition(".")[0]
    imports = list(dict.fromkeys(_imports(path)))
    # `from package.module import name` may mean a module or what is in one; only the former exists by that name
    own = tuple(other for other in imports if other.partition(".")[0] == root and _source(other) is not None)
    others = dict.fromkeys(other.partition(".")[0] for other in imports)
    return own, tuple(other for other in others if other != root and other not in sys.stdlib_module_names)


def _imports(path: Path) -> Iterator[str]:
    """What a file imports when it is imported, and the modules that `from package import name` may mean."""
    for node in ast.parse(path.read_bytes()).body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@functools.cache
def _source(module: str) -> Path | None:
    """The file of a module, found without importing the packages above it."""
    root, *below = module.split(".")
    spec = _spec(root)
    if spec is None:
        return None
    if not below:
        return Path(spec.origin or "compiled")
    for folder in spec.submodule_search_locations or ():
        base = Path(folder).joinpath(*below)
        for path in (base / "__init__.py", base.with_name(base.name + ".py"), *base.parent.glob(f"{base.name}.*.so")):
            if path.exists():
                return path
    return None


def _exists(package: str) -> bool:
    return _spec(package) is not None


@functools.cache
def _spec(package: str) -> ModuleSpec | None:
    try:
        return importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return None
