"""List installed components by role and name, and missing packages; nothing heavy is imported."""

from __future__ import annotations

import argparse
import ast
import functools
import importlib.util
import sys
from collections.abc import Iterator
from importlib import metadata
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which roles."""
    parser.add_argument("role", nargs="?", metavar="ROLE", help="only this role, such as renderers; or `protocols`")


def run(chosen: argparse.Namespace) -> int:
    """Print a line for every name, with the package that provides it and the package that it lacks."""
    from geovp_classic import registry

    if chosen.role == "protocols":
        from geovp_benchmarks import protocols

        print("\n".join(protocol.about for protocol in protocols.ALL.values()))
        return 0
    for role in [chosen.role] if chosen.role else registry.ROLES:
        registry.names(role)  # UnknownComponent with the nearest role
        print(role)
        for entry in sorted(metadata.entry_points(group=f"geovp.{role}"), key=lambda entry: entry.name):
            package = entry.dist.name if entry.dist is not None else ""
            provider = f"[{package}]" if package != "geovp-classic" else ""
            lacks = missing_import(entry.value.partition(":")[0])
            extra = registry.EXTRA_OF_MODULE.get(lacks.partition(".")[0])
            remark = f"(needs extra: {extra})" if extra else f"(needs {lacks})" if lacks else ""
            print("  " + " ".join(filter(None, (entry.name, provider, remark))))
    return 0


def missing_import(module: str) -> str:
    """The first module that importing this one would ask for and not find, "" for none."""
    seen, waiting = {module}, [module]
    while waiting:
        spec = _spec(waiting[0])
        if spec is None:
            return waiting[0]
        own, foreign = _imports(waiting.pop(0), spec.origin or "")
        missing = next((name for name in foreign if _spec(name) is None), None)
        if missing is not None:
            return missing
        waiting += [name for name in own if name not in seen]
        seen.update(own)
    return ""


@functools.cache
def _imports(module: str, file: str) -> tuple[list[str], list[str]]:
    """The imports at the top level of a file: modules of its own package, and other packages."""
    if not file.endswith(".py"):  # compiled
        return [], []
    root = module.partition(".")[0]
    names = list(dict.fromkeys(_imported_names(ast.parse(Path(file).read_bytes()))))
    # `from package.module import name` may mean a module or what is in one; only the former exists by that name
    own = [name for name in names if name.partition(".")[0] == root and _spec(name) is not None]
    others = dict.fromkeys(name.partition(".")[0] for name in names)
    return own, [name for name in others if name != root and name not in sys.stdlib_module_names]


def _imported_names(tree: ast.Module) -> Iterator[str]:
    for node in tree.body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@functools.cache
def _spec(module: str) -> ModuleSpec | None:
    """The place of a module, found without importing the packages above it."""
    package, dot, _ = module.rpartition(".")
    try:
        if not dot:
            return importlib.util.find_spec(module)
        above = _spec(package)
        folders = above.submodule_search_locations if above else None
        return PathFinder.find_spec(module, folders) if folders else None
    except (ImportError, ValueError):
        return None
