"""Description of an installed component: role, purpose, fields, privileged inputs and origin."""

import contextlib
import dataclasses
import inspect
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


def lines(one: ComponentPage) -> list[str]:
    """The page for people."""
    said = [f"{one.name} ({one.role})", "", one.about, ""]
    for field in one.fields:
        said.append(
            f"  {field.name} = {_short(field.default)}"
            + (f"  # {field.meaning}" if field.meaning else "")
        )
    if one.needs is not None:
        inputs = ", ".join(one.needs).lower().replace("_", " ")
        said += ["", f"privileged inputs: {inputs or 'nothing'}"]
    return [*said, f"from {one.source}"]


def _source(kind: type) -> str:
    try:
        return inspect.getsource(kind)
    except (OSError, TypeError):  # made at run time, or compiled
        return ""


def _default(field: dataclasses.Field[Any]) -> Any:
    if field.default is not dataclasses.MISSING:
        return registry.NONE if field.default is None else field.default
    return "required" if field.default_factory is dataclasses.MISSING else field.default_factory()


def _short(value: Any) -> str:
    """A value as in a matrix file; of nested components the names alone."""
    if isinstance(value, dict):
        return f'"{value["name"]}"' if "name" in value else "{...}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_short, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) and value != "required" else str(value)
