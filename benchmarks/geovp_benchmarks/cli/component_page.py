"""Description of an installed component: role, purpose, fields, privileged inputs and origin."""

import contextlib
import dataclasses
import inspect
import json
import re
from importlib import metadata
from typing import Any

from geovp_classic import registry
from geovp_classic.errors import GeovpError
from geovp_classic.types import PrivilegedInput

COMMENT = re.compile(r"^\s+(\w+): .*?  # (.+)$", re.MULTILINE)


@dataclasses.dataclass(frozen=True)
class FieldPage:
    """One setting."""

    name: str
    default: Any  # as in a matrix file; "required" where there is none
    meaning: str  # the comment beside it


@dataclasses.dataclass(frozen=True)
class ComponentPage:
    """What `geovp list NAME` says of a component."""

    role: str
    name: str
    about: str
    fields: tuple[FieldPage, ...]
    needs: (
        tuple[str, ...] | None
    )  # privileged inputs of the component with its defaults; None where that is not known
    source: str


def page(role: str, name: str) -> ComponentPage:
    """The page of a component; MissingExtra where it cannot be imported."""
    kind = registry.load(role, name)
    described, needs = {}, None
    with contextlib.suppress(GeovpError):  # a required field, or weights that are not there
        component = registry.build(role, name)
        described = registry.describe(component)
        privileged_inputs = getattr(component, "needs", None)
        needs = (
            None
            if privileged_inputs is None
            else tuple(str(one.name) for one in PrivilegedInput if one in privileged_inputs)
        )
    meanings = {
        key: text
        for parent in reversed(kind.__mro__[:-1])
        for key, text in COMMENT.findall(_source(parent))
    }
    fields = tuple(
        FieldPage(
            field.name, described.get(field.name, _default(field)), meanings.get(field.name, "")
        )
        for field in (dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ())
        if field.init
    )
    (entry,) = (one for one in metadata.entry_points(group=f"geovp.{role}") if one.name == name)
    package = (
        f"{entry.dist.name} {entry.dist.version}"
        if entry.dist is not None
        else "an unknown package"
    )
    return ComponentPage(
        role, name, inspect.getdoc(kind) or "", fields, needs, f"{entry.value} of {package}"
    )


def lines(page: ComponentPage) -> list[str]:
    """Write the page as TOML for a matrix file, with the explanations as comments."""
    about = [f"{page.name} ({page.role})", "", *page.about.splitlines()]
    said = [f"# {line}".rstrip() for line in about]
    if page.needs is not None:
        inputs = ", ".join(page.needs).lower().replace("_", " ")
        said.append(f"# privileged inputs: {inputs or 'nothing'}")
    said.append(f"# from {page.source}")
    if page.role in ("pose_sources", "renderers", "predictors"):  # tables of a matrix file
        said.append(f"[{page.role}.{page.name}]")
    said.append(f'name = "{page.name}"')
    for field in page.fields:
        meaning = f"  # {field.meaning}" if field.meaning else ""
        if field.default == "required":
            said.append(f"# {field.name} =   (required){meaning}")
        else:
            said.append(f"{field.name} = {_toml(field.default)}{meaning}")
    return said


def _source(kind: type) -> str:
    try:
        return inspect.getsource(kind)
    except (OSError, TypeError):  # made at run time, or compiled
        return ""


def _default(field: dataclasses.Field[Any]) -> Any:
    if field.default is not dataclasses.MISSING:
        return registry.NONE if field.default is None else field.default
    return "required" if field.default_factory is dataclasses.MISSING else field.default_factory()


def _toml(value: Any) -> str:
    """Write a value as TOML on one line."""
    if dataclasses.is_dataclass(value):
        value = registry.describe(value)
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {_toml(item)}' for key, item in value.items())}}}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, (bool, str)):
        return json.dumps(value)
    return str(value)
