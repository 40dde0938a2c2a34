"""List components, or print one as TOML.

The TOML can be pasted into a matrix file.

Examples:
  geovp list
  geovp list renderers
  geovp list depth-fusion
  geovp list matrices
  geovp list protocols
"""

import argparse
import dataclasses
import importlib.util
import inspect
import itertools
import json
import re
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Any

from geovp_benchmarks.cli.options import Lines, option
from geovp_classic.errors import GeovpError, UnknownComponent

ARGUMENTS = {
    "": {
        "name NAME": option(
            "Role such as renderers, name of a component, `matrices` or `protocols`. "
            "Default: all roles.",
            nargs="?",
        )
    }
}


def run(args: argparse.Namespace) -> Lines:
    """Print roles with their components, one component, the matrices or the protocols."""
    from geovp_benchmarks.matrix import CONFIGS, protocols
    from geovp_classic import registry

    names_of = {role: registry.names(role) for role in registry.ROLES}
    roles = [role for role, names in names_of.items() if args.name in names]
    if args.name == "matrices":
        for path in sorted(CONFIGS.glob("*.toml")):
            comment, _, _ = path.read_text("utf-8").partition("\n\n")
            yield f"{path.stem}: {first_sentence(comment.replace('#', ''))}"
    elif args.name == "protocols":
        yield protocols.TABLES.read_text("utf-8")
    elif args.name is None or args.name in names_of:
        for role in [args.name] if args.name else names_of:
            yield role
            for entry in sorted(metadata.entry_points(group=f"geovp.{role}")):
                yield f"  {summary(entry)}"
    elif roles:
        yield "\n\n".join(as_toml(role, args.name) for role in roles)
    else:
        words = ["matrices", "protocols", *names_of, *itertools.chain(*names_of.values())]
        nearest = registry.nearest(args.name, words)
        raise UnknownComponent(f"there is no role or component {args.name!r}{nearest}")


def summary(entry: metadata.EntryPoint) -> str:
    """Return a component's name, package and explanation."""
    text, package = entry.name, entry.dist.name if entry.dist else ""
    if package != "geovp":
        text += f" [{package}]"
    docstring = re.search(
        rf'^class {entry.attr}\b.*?"""(.*?)"""', source(entry.module), re.M | re.S
    )
    return f"{text}: {first_sentence(docstring[1])}" if docstring else text


def first_sentence(text: str) -> str:
    """Return the first sentence of a text on one line, without its full stop."""
    return re.split(r"\.\s+(?=[A-Z`])", " ".join(text.split()))[0].removesuffix(".")


def source(module: str) -> str:
    """Return the source of a module, without importing it; "" for a package."""
    package, *names = module.split(".")
    spec = importlib.util.find_spec(package)
    path = Path(spec.origin or "") if spec else Path()
    if names:
        path = path.parent.joinpath(*names).with_suffix(".py")
    return path.read_text("utf-8") if path.is_file() else ""


def as_toml(role: str, name: str) -> str:
    """Return a component as TOML for a matrix file, with explanations as comments."""
    from geovp_classic import registry
    from geovp_classic.types import PrivilegedInput

    kind = registry.load(role, name)
    component = None
    lines = [f"{name} ({role})", "", *(inspect.getdoc(kind) or "").splitlines()]
    with suppress(GeovpError):  # a required field, or missing weights
        component = registry.build(role, name)
        needs = getattr(component, "needs", PrivilegedInput.NONE)
        inputs = [str(flag.name).lower().replace("_", " ") for flag in needs]
        lines.append(f"privileged inputs: {', '.join(inputs) or 'none'}")
    lines.append(f"from {kind.__module__}:{kind.__qualname__}")
    lines = [f"# {line}".rstrip() for line in lines]
    # Of these roles, a component is a table of a matrix file
    heading = f"{role}.{name}" if role in ("pose_sources", "renderers", "predictors") else ""
    if heading:
        lines.append(f"[{heading}]")
    fields = table_lines(kind, component, heading)
    return "\n".join([*lines, f'name = "{name}"', *fields])


def table_lines(kind: type, settings: Any, heading: str) -> list[str]:
    """Return the fields of a dataclass as TOML; those that are dataclasses follow as tables.

    `settings` is an instance, or None for the defaults.
    """
    from geovp_classic import registry

    sources = "".join(inspect.getsource(parent) for parent in reversed(kind.__mro__[:-1]))
    comments = dict(re.findall(r"^    (\w+): .*?(  # .+)$", sources, re.MULTILINE))
    lines, tables = [], []
    for field in dataclasses.fields(kind):
        value = getattr(settings, field.name, field.default)
        if value is dataclasses.MISSING is not field.default_factory:
            value = field.default_factory()
        comment = comments.get(field.name, "")
        values = value if isinstance(value, tuple) else (value,)
        if value is dataclasses.MISSING:
            lines.append(f"# {field.name} =   (required){comment}")
        elif values and all(map(dataclasses.is_dataclass, values)):
            path = f"{heading}.{field.name}".removeprefix(".")
            title = f"[[{path}]]" if values is value else f"[{path}]"
            for nested in values:
                tables += ["", f"{title}{comment}"]
                with suppress(UnknownComponent):  # other settings have no name
                    tables.append(f'name = "{registry.name_of(nested)}"')
                tables += table_lines(type(nested), nested, path)
        else:
            lines.append(f"{field.name} = {toml_value(value)}{comment}")
    return lines + tables


def toml_value(value: Any) -> str:
    """Return a value as TOML on one line."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, (bool, str, Path)):
        return json.dumps(value, default=str)
    return '"none"' if value is None else str(value)
