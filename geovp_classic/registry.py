"""Registry of components: build them from names and settings, and describe them as such tables.

Components register under entry-point groups `geovp.<role>` and are imported on first use.
"""

import contextlib
import contextvars
import dataclasses
import functools
import inspect
import json
import types
import typing
from collections.abc import Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, Union

from geovp_classic import interfaces
from geovp_classic.errors import BadData, GeovpError, MissingExtra, UnknownComponent
from geovp_classic.errors import install_command as install_command
from geovp_classic.errors import nearest as nearest

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
    "set_metrics": interfaces.SetMetric,
    "datasets": interfaces.Dataset,
}
ROLES = (*PROTOCOL_OF_ROLE, "executors")
NONE = "none"  # stands for None in tables, because TOML has no null
EXTRA_OF_MODULE = {
    "torch": "learned",
    "safetensors": "learned",
    "lightning": "learned",
    "dask": "cluster",
    "open3d": "volume",
    "argcomplete": "completion",
    "rosbags": "rosbag",
    "onnx": "onnx",
    "onnxruntime": "pretrained",
    "transformers": "pretrained",
}

_defaults: contextvars.ContextVar[Mapping[str, Any]] = contextvars.ContextVar("defaults")


def names(role: str) -> list[str]:
    """Return the sorted names registered for a role; nothing is imported."""
    return sorted(_entry_points(role))


def load(role: str, name: str) -> type:
    """Import the class registered under a name.

    Raises UnknownComponent with the nearest name, or MissingExtra if the import fails.
    """
    entry_points = _entry_points(role)
    if name not in entry_points:
        raise UnknownComponent(f"{role} have no {name!r}{nearest(name, entry_points)}")
    try:
        return typing.cast(type, entry_points[name].load())
    except (ImportError, AttributeError, OSError) as error:
        module = str(getattr(error, "name", "")).partition(".")[0]
        extra = EXTRA_OF_MODULE.get(module)
        remedy = install_command(extra) if extra else "fix or reinstall its package"
        raise MissingExtra(
            f"component {name!r} of {role} cannot be loaded ({error}): {remedy}"
        ) from error


def build(role: str, spec: Mapping[str, Any] | str, where: str = "") -> Any:
    """Build a component from {"name": ..., **fields} or its name; nested tables build components.

    Messages call the place in the user's file `where`. Raises UnknownComponent, MissingExtra or
    BadData.
    """
    where = where or role
    table: Any = {"name": spec} if isinstance(spec, str) else spec
    if not isinstance(table, Mapping) or not isinstance(table.get("name"), str):
        raise BadData(
            f'{where}: {spec!r} is not a component, expected a table like {{ name = "..." }}'
        )
    settings = dict(table)
    name = settings.pop("name")
    return construct(load(role, name), settings, where, name)


@contextlib.contextmanager
def defaults(**fields: Any) -> Iterator[None]:
    """Override the default of each field with one of these names, in nested components, too."""
    token = _defaults.set({**_defaults.get({}), **fields})
    try:
        yield
    finally:
        _defaults.reset(token)


def construct(kind: type, settings: Mapping[str, Any], where: str, name: str = "") -> Any:
    """Build a dataclass from a table of its fields, checked against their types.

    Messages call it `name` and the place in the user's file `where`. Raises UnknownComponent for
    an unknown field, and BadData for a missing field or a value of another type.
    """
    name = name or kind.__name__
    if not dataclasses.is_dataclass(kind):
        raise BadData(f"{name} is not a dataclass: a component's fields are its settings")
    fields = inspect.signature(kind).parameters
    values = {key: value for key, value in _defaults.get({}).items() if key in fields}
    values = values_of(kind, {**values, **settings}, where, name)
    for key, field in fields.items():
        if key not in values and field.default is field.empty:
            raise BadData(f"{where}: {name!r} needs the field {key!r}: add it to the table")
    try:
        return kind(**values)
    except GeovpError as error:
        raise type(error)(f"{where}: {error}") from error


def values_of(kind: type, settings: Mapping[str, Any], where: str, name: str) -> dict[str, Any]:
    """Return fields of a dataclass from a table of them; raise as `construct`."""
    hints = typing.get_type_hints(kind)
    fields = inspect.signature(kind).parameters
    values = {}
    for key, value in settings.items():
        if key not in fields:
            raise UnknownComponent(f"{where}: {name!r} has no field {key!r}{nearest(key, fields)}")
        values[key] = _value(value, hints[key], f"{where}.{key}")
    return values


def describe(component: Any) -> dict[str, Any]:
    """Return the table from which `build` makes this component, with all of its fields."""
    return {"name": name_of(component), **_settings(component)}


def name_of(component: Any) -> str:
    """Return the registered name of a component's class; UnknownComponent if it has none."""
    kind = type(component)
    path = f"{kind.__module__}:{kind.__qualname__}"
    for role in ROLES:
        for name, entry_point in _entry_points(role).items():
            if entry_point.value == path:
                return name
    raise UnknownComponent(f"{path} is not registered: add it to the entry points of its package")


@functools.cache
def _entry_points(role: str) -> dict[str, metadata.EntryPoint]:
    if role not in ROLES:
        raise UnknownComponent(f"there is no role {role!r}{nearest(role, ROLES)}")
    group = metadata.entry_points(group=f"geovp.{role}")
    return {entry_point.name: entry_point for entry_point in group}


def _settings(component: Any) -> dict[str, Any]:
    """Return the fields of a dataclass as plain values, without a None that is the default."""
    table = {}
    for field in dataclasses.fields(component):
        value = getattr(component, field.name)
        if field.init and (value is not None or field.default is not None):
            table[field.name] = NONE if value is None else _plain(value)
    return table


def _plain(value: Any) -> Any:
    """Return a field's value as TOML and JSON have it."""
    if isinstance(value, tuple(PROTOCOL_OF_ROLE.values())):
        return describe(value)
    if dataclasses.is_dataclass(value):
        return _settings(value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    return value


def _value(value: Any, kind: Any, where: str) -> Any:
    """Return a TOML value as a field's type; raise BadData if it is of another type.

    Of several types, the first that accepts it counts.
    """
    origin = typing.get_origin(kind)
    options = typing.get_args(kind)
    # A union: the first type that accepts the value
    if origin in (Union, types.UnionType):
        *others, last = (option for option in options if option is not types.NoneType)
        if value in (NONE, None) and types.NoneType in options:
            return None
        for option in others:
            with contextlib.suppress(BadData):
                return _value(value, option, where)
        return _value(value, last, where)
    # A choice, or a tuple of values
    if origin is Literal:
        if value not in options:
            raise BadData(f"{where} is {value!r}{nearest(str(value), map(str, options))}")
        return value
    if origin is tuple and isinstance(value, (list, tuple)):
        kinds = options[:1] * len(value) if options[-1] is Ellipsis else options
        if len(value) != len(kinds):
            raise BadData(f"{where} has {len(value)} values, expected {len(kinds)}")
        items = enumerate(zip(value, kinds, strict=True))
        return tuple(_value(item, kind, f"{where}[{i}]") for i, (item, kind) in items)
    # A component by its table, or settings that are not registered
    for role, protocol in PROTOCOL_OF_ROLE.items():
        if kind is protocol:
            return build(role, value, where)
    if dataclasses.is_dataclass(kind) and isinstance(value, Mapping):
        return construct(typing.cast(type, kind), value, where)
    # A plain value
    if kind is Path and isinstance(value, (str, Path)):
        return Path(value).expanduser()
    if kind is float and type(value) is int:
        return float(value)
    if type(value) is kind:
        return value
    texts = {
        float: "a number",
        int: "a whole number",
        bool: "true or false",
        str: "a text in quotes",
        Path: "a path",
    }
    expected = texts.get(kind, "a table")
    if origin is tuple:
        item = str(value) if options[0] is str else value
        expected = f"a list, as {json.dumps([item], default=str)}"
    raise BadData(f"{where} is {value!r}, expected {expected}")
