"""List components, or print one as TOML.

The TOML can be pasted into a matrix file; nested keys are dotted, as in --set.

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
from collections.abc import Iterator
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
    from geovp_benchmarks.matrix import CONFIGS, papers
    from geovp_classic import registry

    names_of = {role: registry.names(role) for role in registry.ROLES}
    roles = [role for role, names in names_of.items() if args.name in names]
    if args.name == "matrices":
        for path in sorted(CONFIGS.glob("*.toml")):
            comment, _, _ = path.read_text("utf-8").partition("\n\n")
            yield f"{path.stem}: {first_sentence(comment.replace('#', ''))}"
    elif args.name == "protocols":
        for paper in map(papers.load, papers.names()):
            yield f"[{paper.name}]"
            for key, value in paper.model_dump(exclude={"name", "published"}).items():
                yield f"{key} = {json.dumps(value, ensure_ascii=False)}"
            yield ""
    elif args.name is None or args.name in names_of:
        for role in [args.name] if args.name else names_of:
            yield role
            for entry in sorted(metadata.entry_points(group=f"geovp.{role}")):
                yield f"  {summary(entry)}"
    elif roles:
        yield "\n\n".join("\n".join(as_toml(role, args.name)) for role in roles)
    else:
        words = ["matrices", "protocols", *names_of, *itertools.chain(*names_of.values())]
        nearest = registry.nearest(args.name, words)
        raise UnknownComponent(f"there is no role or component {args.name!r}{nearest}")


def summary(entry: metadata.EntryPoint) -> str:
    """Return a component's name, package and explanation; its module is not imported."""
    text, distribution = entry.name, entry.dist.name if entry.dist else ""
    if distribution != "geovp":
        text += f" [{distribution}]"
    package, *names = entry.module.split(".")
    spec = importlib.util.find_spec(package)
    path = Path((spec and spec.origin) or package)
    path = path.parent.joinpath(*names or [path.name]).with_suffix(".py")
    source = path.read_text("utf-8") if path.is_file() else ""
    docstring = re.search(rf'^class {entry.attr}\b.*?"""(.*?)"""', source, re.M | re.S)
    return f"{text}: {first_sentence(docstring[1])}" if docstring else text


def first_sentence(text: str) -> str:
    """Return the first sentence of a text on one line, without its full stop."""
    return re.split(r"\.\s+(?=[A-Z`])", " ".join(text.split()))[0].removesuffix(".")


def as_toml(role: str, name: str) -> Iterator[str]:
    """Yield a component as TOML for a matrix file, with explanations as comments."""
    from geovp_classic import registry
    from geovp_classic.types import PrivilegedInput

    kind = registry.load(role, name)
    component = None
    lines = [f"{name} ({role})", "", *(inspect.getdoc(kind) or "").splitlines()]
    with suppress(GeovpError):  # a required field, or missing weights
        component = registry.build(role, name)
        inputs = str(getattr(component, "needs", PrivilegedInput.NONE).name).lower()
        lines.append(f"privileged inputs: {inputs.replace('_', ' ').replace('|', ', ')}")
    lines.append(f"from {kind.__module__}:{kind.__qualname__}")
    yield from (f"# {line}".rstrip() for line in lines)
    if role in ("pose_sources", "renderers", "predictors"):  # tables of a matrix file
        yield f"[{role}.{name}]"
    yield f'name = "{name}"'
    yield from field_lines(kind, component)


def field_lines(kind: type, settings: Any, prefix: str = "") -> Iterator[str]:
    """Yield the fields of a dataclass as TOML; the keys of those that are dataclasses are dotted.

    `settings` is an instance, or None for the defaults.
    """
    from geovp_classic import registry

    sources = "".join(inspect.getsource(parent) for parent in reversed(kind.__mro__[:-1]))
    comments = dict(re.findall(r"^    (\w+): .*?(  # .+)$", sources, re.MULTILINE))
    for field in dataclasses.fields(kind):
        value = getattr(settings, field.name, field.default)
        if value is dataclasses.MISSING is not field.default_factory:
            value = field.default_factory()
        key, comment = prefix + field.name, comments.get(field.name, "")
        if value is dataclasses.MISSING:
            yield f"# {key} =   (required){comment}"
        elif dataclasses.is_dataclass(value):
            with suppress(UnknownComponent):  # other settings have no name
                yield f'{key}.name = "{registry.name_of(value)}"'
            yield from field_lines(type(value), value, f"{key}.")
        else:
            text = json.dumps(registry.NONE if value is None else value, default=registry.name_of)
            yield f"{key} = {text}{comment}"
