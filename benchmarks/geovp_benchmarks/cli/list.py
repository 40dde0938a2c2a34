"""List installed components by role and name, and missing packages; nothing heavy is imported."""

import argparse
import ast
import dataclasses
import functools
import importlib.util
import json
import re
import sys
from collections.abc import Iterator
from importlib import metadata
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path

from geovp_benchmarks.arguments import add_json, complete_with


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which roles, or which component."""
    which = (
        "only this role, such as renderers, or all about a component of this name; or `protocols`"
    )
    complete_with(
        parser.add_argument("what", nargs="?", metavar="ROLE|NAME", help=which),
        role_and_component_names,
    )
    add_json(parser)


def role_and_component_names() -> list[str]:
    """What the argument may be, without any import."""
    groups = [group for group in metadata.entry_points().groups if group.startswith("geovp.")]
    names = [entry.name for group in groups for entry in metadata.entry_points(group=group)]
    return ["protocols", *(group.removeprefix("geovp.") for group in groups), *names]


def run(chosen: argparse.Namespace) -> int:
    """Print a line for every name, with the package that provides it and the package
    that it lacks.
    """
    from geovp_classic import registry

    if chosen.what == "protocols":
        return _list_protocols(chosen.json)
    if chosen.what and chosen.what not in registry.ROLES:
        return _show(chosen.what, chosen.json)
    roles = {role: _entries(role) for role in ([chosen.what] if chosen.what else registry.ROLES)}
    if chosen.json:
        print(json.dumps(roles, indent=2))
        return 0
    for role, entries in roles.items():
        print(role)
        for entry in entries:
            provider = f"[{entry['package']}]" if entry["package"] != "geovp-classic" else ""
            lacks = f"(needs {entry['lacks']})" if entry["lacks"] else ""
            remark = f"(needs extra: {entry['extra']})" if entry["extra"] else lacks
            print(
                "  "
                + " ".join(filter(None, (entry["name"], provider, remark)))
                + f": {entry['about']}" * bool(entry["about"])
            )
    return 0


def _entries(role: str) -> list[dict[str, str]]:
    """Name, package, the module that it lacks and the extra that has it, "" where nothing is to be
    said.
    """
    from geovp_classic import registry

    found = []
    for entry in sorted(metadata.entry_points(group=f"geovp.{role}"), key=lambda entry: entry.name):
        lacks = missing_import(entry.value.partition(":")[0])
        extra = registry.EXTRA_OF_MODULE.get(lacks.partition(".")[0], "")
        package = entry.dist.name if entry.dist is not None else ""
        found.append(
            {
                "name": entry.name,
                "package": package,
                "lacks": lacks,
                "extra": extra,
                "about": _about(entry.value),
            }
        )
    return found


def _about(place: str) -> str:
    """Read the first sentence of a component's docstring, without importing it."""
    module, _, name = place.partition(":")
    spec = _spec(module)
    if spec is None or not (spec.origin or "").endswith(".py"):
        return ""
    for node in ast.parse(Path(str(spec.origin)).read_bytes()).body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.name == name:
            paragraph = (ast.get_docstring(node) or "").partition("\n\n")[0]
            return re.split(r"\.\s+(?=[A-Z])", " ".join(paragraph.split()))[0].removesuffix(".")
    return ""


def _show(name: str, as_json: bool) -> int:
    """Print all about the components of a name, in every role that has one."""
    from geovp_benchmarks.cli import component_page
    from geovp_classic import registry
    from geovp_classic.errors import UnknownComponent

    known = {role: registry.names(role) for role in registry.ROLES}
    pages = [component_page.page(role, name) for role, names in known.items() if name in names]
    if not pages:
        words = {*known, *(one for names in known.values() for one in names)}
        raise UnknownComponent(
            f"there is no role or component {name!r}{registry.nearest(name, words)}"
        )
    if as_json:
        print(json.dumps([dataclasses.asdict(page) for page in pages], indent=2, default=str))
    else:
        print("\n\n".join("\n".join(component_page.lines(page)) for page in pages))
    return 0


def _list_protocols(as_json: bool) -> int:
    from geovp_benchmarks.matrix import protocols

    tables = {name: protocol.model_dump() for name, protocol in protocols.ALL.items()}
    print(json.dumps(tables, indent=2) if as_json else protocols.TABLES.read_text("utf-8"))
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
    # `from package.module import name` may mean a module or what is in one; only the former exists
    # by that name
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
