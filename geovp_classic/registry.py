"""Build components, ours or a plug-in's, from a name and settings, and describe them as such a
table again.

Components register under entry-point groups `geovp.<role>` and are imported only when asked for by
name.
"""

import contextlib
import contextvars
import dataclasses
import difflib
import functools
import json
import logging
import pathlib
import types
import typing
from collections.abc import Iterable, Iterator, Mapping
from importlib import metadata
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

from geovp_classic import interfaces
from geovp_classic.errors import BadData, GeovpError, MissingExtra, UnknownComponent

logger = logging.getLogger(__name__)

PROTOCOL_OF_ROLE: dict[str, type] = {
    "pose_sources": interfaces.PoseSource,
    "pose_refinements": interfaces.PoseRefinement,
    "odometries": interfaces.Odometry,
    "forecasters": interfaces.Forecaster,
    "scales": interfaces.Scale,
    "depth_sources": interfaces.DepthSource,
    "renderers": interfaces.Renderer,
    "inpainters": interfaces.Inpainter,
    "predictors": interfaces.FramePredictor,
    "frame_metrics": interfaces.FrameMetric,
    "trajectory_metrics": interfaces.TrajectoryMetric,
    "datasets": interfaces.Dataset,
}
ROLES = (*PROTOCOL_OF_ROLE, "executors")
NO_PART = "none"  # TOML has no None: this leaves a part out
EXTRA_OF_MODULE = dict.fromkeys(("torch", "safetensors", "lightning"), "learned") | {
    "dask": "cluster",
    "rerun": "viz",
}
EXTRA_OF_MODULE |= {"open3d": "volume", "av": "video", "argcomplete": "completion", "onnx": "onnx"}

_DEFAULTS: contextvars.ContextVar[Mapping[str, Any]] = contextvars.ContextVar("defaults")


def names(role: str) -> list[str]:
    """The names registered for a role, sorted; nothing is imported."""
    return sorted(_entry_points(role))


def load(role: str, name: str) -> type:
    """The class behind a name; UnknownComponent with the nearest name, MissingExtra when it cannot
    be imported.
    """
    entry_points = _entry_points(role)
    if name not in entry_points:
        raise UnknownComponent(
            f"no {_singular(role)} is called {name!r}{nearest(name, entry_points)}"
        )
    entry_point = entry_points[name]
    logger.info(
        "importing %s, %s %r of %s", entry_point.value, _singular(role), name, _package(entry_point)
    )
    try:
        component: type = entry_point.load()
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        extra = EXTRA_OF_MODULE.get(module)
        remedy = install_command(extra) if extra else f"install {module or 'the missing module'}"
        raise MissingExtra(
            f"{_singular(role)} {name!r} needs {module}, which is not installed: {remedy}"
        ) from error
    except (ImportError, AttributeError, OSError) as error:
        raise MissingExtra(
            f"{_singular(role)} {name!r} cannot be loaded ({error}): mend or reinstall it"
        ) from error
    return component


def install_command(extra: str) -> str:
    """The pip command that adds an extra, from the clone or the file that GeoVP itself was
    installed from (PEP 610).
    """
    about = json.loads(metadata.distribution("geovp-classic").read_text("direct_url.json") or "{}")
    url = urlsplit(about.get("url", ""))
    origin = url2pathname(url.path) if url.scheme == "file" else ""
    known = origin if origin and pathlib.Path(origin).exists() else "geovp-classic"
    edited = "--editable " if about.get("dir_info", {}).get("editable") and known == origin else ""
    return f"pip install {edited}'{known}[{extra}]'"


def build(role: str, spec: Mapping[str, Any] | str, where: str = "") -> Any:
    """The component of {"name": ..., **fields}; fields that are components are built from nested
    tables.

    `where` names the place in the user's file for messages. Raises UnknownComponent, MissingExtra
    or BadData.
    """
    where = where or role
    table: Mapping[str, Any] = {"name": spec} if isinstance(spec, str) else spec
    if not isinstance(table, Mapping) or not isinstance(table.get("name"), str):
        raise BadData(
            f'{where}: {spec!r} is not a component, expected a table like {{ name = "..." }}'
        )
    given = {key: value for key, value in table.items() if key != "name"}
    return construct(load(role, table["name"]), given, where, table["name"])


@contextlib.contextmanager
def defaults(**fields: Any) -> Iterator[None]:
    """Within it, components that have one of these fields and are not given it get this value,
    nested ones too.
    """
    token = _DEFAULTS.set(fields)
    try:
        yield
    finally:
        _DEFAULTS.reset(token)


def construct(kind: type, given: Mapping[str, Any], where: str, name: str = "") -> Any:
    """The dataclass of a table of its fields, checked against their types; `name` is what messages
    call it.

    `where` names the place in the user's file. Raises UnknownComponent for a field that it lacks,
    BadData for a value of another type and for a required field that is not given.
    """
    name, hints = name or kind.__name__, _field_types(kind)
    given = {key: value for key, value in _DEFAULTS.get({}).items() if key in hints} | dict(given)
    for key in given:
        if key not in hints:
            raise UnknownComponent(f"{where}: {name!r} has no field {key!r}{nearest(key, hints)}")
    for field in dataclasses.fields(kind):
        required = (
            field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        )
        if field.init and required and field.name not in given:
            raise BadData(f"{where}: {name!r} needs the field {field.name!r}: add it to the table")
    fields = {key: _value(value, hints[key], f"{where}.{key}") for key, value in given.items()}
    try:
        return kind(**fields)
    except GeovpError as error:
        raise type(error)(f"{where}: {error}") from error


def describe(component: Any) -> dict[str, Any]:
    """The table that `build` makes this component of, every field spelled out; its inverse."""
    if not dataclasses.is_dataclass(component):
        raise BadData(f"{component!r} is not a dataclass, so its settings cannot be described")
    return {"name": name_of(component), **_settings(component)}


def _settings(owner: Any) -> dict[str, Any]:
    """The fields of a dataclass as plain values; a None that is the default is left out."""
    values = [
        (field, _plain(getattr(owner, field.name)))
        for field in dataclasses.fields(owner)
        if field.init
    ]
    return {
        field.name: NO_PART if value is None else value
        for field, value in values
        if value is not None or field.default is not None
    }


def name_of(component: Any) -> str:
    """The registered name of a component's class; UnknownComponent when it has none."""
    kind = type(component)
    wanted = f"{kind.__module__}:{kind.__qualname__}"
    for role in ROLES:
        for name, entry_point in _entry_points(role).items():
            if entry_point.value == wanted and _fits(role, component):
                return name
    raise UnknownComponent(f"{wanted} is not registered: add it to the entry points of its package")


def nearest(word: str, known: Iterable[str]) -> str:
    """A tail for a message: the nearest known word, or all of them."""
    known = sorted(known)
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f": did you mean {close[0]!r}?" if close else f": known are {', '.join(known) or 'none'}"


@functools.cache
def _entry_points(role: str) -> dict[str, metadata.EntryPoint]:
    if role not in ROLES:
        raise UnknownComponent(f"there is no role {role!r}{nearest(role, ROLES)}")
    return {
        entry_point.name: entry_point
        for entry_point in metadata.entry_points(group=f"geovp.{role}")
    }


def _package(entry_point: metadata.EntryPoint) -> str:
    return (
        "an unknown package"
        if entry_point.dist is None
        else f"{entry_point.dist.name} {entry_point.dist.version}"
    )


def _singular(role: str) -> str:
    return (
        role.removesuffix("ies") + "y"
        if role.endswith("ies")
        else role.removesuffix("s").replace("_", " ")
    )


def _fits(role: str, component: Any) -> bool:
    protocol = PROTOCOL_OF_ROLE.get(role)
    return protocol is None or isinstance(component, protocol)


def _field_types(component: type) -> dict[str, Any]:
    if not dataclasses.is_dataclass(component):
        raise BadData(
            f"{component.__name__} is not a dataclass: a component's fields are its settings"
        )
    hints = typing.get_type_hints(component)
    return {field.name: hints[field.name] for field in dataclasses.fields(component) if field.init}


def _plain(value: Any) -> Any:
    """A field's value as TOML and JSON have it."""
    if dataclasses.is_dataclass(value):
        return (
            describe(value)
            if any(_fits(role, value) for role in PROTOCOL_OF_ROLE)
            else _settings(value)
        )
    if isinstance(value, pathlib.Path):
        return str(value)
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    return value


def _value(value: Any, wanted: Any, where: str) -> Any:
    """A TOML value as the field's type; BadData when it is of another type."""
    origin = typing.get_origin(wanted)
    if origin in (typing.Union, types.UnionType):
        return _optional(value, typing.get_args(wanted), where)
    role = next((role for role, protocol in PROTOCOL_OF_ROLE.items() if protocol is wanted), None)
    if role is not None:
        return build(role, value, where)
    if origin is typing.Literal:
        if value not in typing.get_args(wanted):
            raise BadData(
                f"{where} is {value!r}{nearest(str(value), map(str, typing.get_args(wanted)))}"
            )
        return value
    if origin is tuple and isinstance(value, (list, tuple)):
        return _tuple(value, typing.get_args(wanted), where)
    if dataclasses.is_dataclass(wanted) and isinstance(wanted, type) and isinstance(value, Mapping):
        return construct(wanted, value, where)
    if wanted is pathlib.Path and isinstance(value, (str, pathlib.Path)):
        return pathlib.Path(value).expanduser()
    if wanted is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if (
        isinstance(wanted, type)
        and isinstance(value, wanted)
        and isinstance(value, bool) == (wanted is bool)
    ):
        return value
    raise BadData(f"{where} is {value!r}, expected {_type_name(wanted)}")


def _tuple(values: Iterable[Any], kinds: tuple[Any, ...], where: str) -> tuple[Any, ...]:
    values = list(values)
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = (kinds[0],) * len(values)
    if len(values) != len(kinds):
        raise BadData(f"{where} has {len(values)} values, expected {len(kinds)}")
    return tuple(
        _value(v, kind, f"{where}[{i}]")
        for i, (v, kind) in enumerate(zip(values, kinds, strict=True))
    )


def _optional(value: Any, kinds: tuple[Any, ...], where: str) -> Any:
    """The value as the first of several types that accepts it; the last one's error
    when none does.
    """
    if value == NO_PART and type(None) in kinds:
        return None
    *others, last = (kind for kind in kinds if kind is not type(None))
    for kind in others:
        with contextlib.suppress(BadData):
            return _value(value, kind, where)
    return _value(value, last, where)


def _type_name(wanted: Any) -> str:
    plain = {
        float: "a number",
        int: "a whole number",
        str: "a text",
        bool: "true or false",
        pathlib.Path: "a path",
    }
    return plain.get(wanted, str(getattr(wanted, "__name__", wanted)))
