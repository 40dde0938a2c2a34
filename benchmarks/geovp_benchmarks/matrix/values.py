"""Types of the values in a matrix file, and the sentence that says what is wrong with one."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, GetCoreSchemaHandler, TypeAdapter, ValidationError
from pydantic_core import CoreSchema, ErrorDetails, core_schema

from geovp_benchmarks.matrix import DEVICE
from geovp_classic.errors import BadData, GeovpError, UnknownComponent
from geovp_classic.registry import nearest


@dataclass(frozen=True)
class Expected:
    """An annotation that states in words what a value of its type is."""

    text: str

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the schema of the type, with this text in place of pydantic's messages."""
        return core_schema.custom_error_schema(
            handler(source), "expected", custom_error_message=f"expected {self.text}"
        )


def _named(value: Any) -> Any:
    """Return the table of a component, which may be given by its name alone."""
    table = {"name": value} if isinstance(value, str) else value
    if not isinstance(table, Mapping) or not isinstance(table.get("name"), str):
        raise ValueError('expected a table such as { name = "..." }')
    return table


def _by_name(value: Any) -> Any:
    """Return components by the names of columns or folders; a list uses their names."""
    if isinstance(value, Mapping):
        return value
    if not isinstance(value, list):
        raise ValueError('expected a list such as ["psnr", "ssim"]')
    tables = [_named(table) for table in value]
    names = [table["name"] for table in tables]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(
                f"expected {name!r} once: give a table, such as {{ other = {{ name = {name!r} }} }}"
            )
    return dict(zip(names, tables, strict=True))


IsNamed = BeforeValidator(_named)
Spec = Annotated[dict[str, Any], IsNamed]  # {"name": ..., **fields}, as `registry.build` takes it
Specs = Annotated[dict[str, Spec], BeforeValidator(_by_name)]
Count = Annotated[
    int,
    Field(strict=True, ge=1, lt=2**31),
    Expected("a whole number of 1 or more, below 2 to the 31"),
]
Device = Annotated[str, Field(pattern=DEVICE), Expected("cpu, cuda, cuda:N or auto")]
# The name of a method has two of these, and file systems allow 255 bytes.
FolderName = Annotated[
    str,
    Field(pattern=r"^[A-Za-z0-9_+=,][A-Za-z0-9_+=,.-]{0,95}$"),
    Expected("at most 96 letters, digits and _ + = , . - because it becomes a folder's name"),
]
Size = Annotated[tuple[Count, Count], Expected("[width, height] in pixels, such as [256, 256]")]


def validated(kind: Any, value: object, where: str = "") -> Any:
    """Return a value as a type.

    BadData or UnknownComponent states the place, the value and what was expected.
    """
    try:
        return TypeAdapter(kind).validate_python(value)
    except ValidationError as error:
        details = error.errors()
        unknown = [each for each in details if each["type"] == "extra_forbidden"]
        raise _explained((unknown or details)[0], kind, where) from None


def _explained(error: ErrorDetails, kind: Any, where: str) -> GeovpError:
    """Return the error of one value in a sentence."""
    path = [str(key) for key in error["loc"] if key != "[key]"]
    place = ".".join([where, *path]).strip(".")
    if error["type"] == "extra_forbidden":
        for key in path[:-1]:
            kind = kind.model_fields[key].annotation
        table = ".".join(path[:-1]) or "the matrix file"
        hint = nearest(path[-1], kind.model_fields)
        return UnknownComponent(f"{table} has an unknown key {path[-1]!r}{hint}")
    if error["type"] == "missing":
        return BadData(f"{place} is missing: add it to the matrix file")
    reason = error["msg"].removeprefix("Value error, ")
    if error["type"] in ("dict_type", "model_type"):
        reason = f"expected a table [{place}]"
    return BadData(f"{place} is {error['input']!r}, {reason}")


def check_storable(value: object, where: str = "") -> None:
    """Raise BadData for a value that results cannot hold: a date or NaN."""
    if isinstance(value, dict):
        for key, item in value.items():
            check_storable(item, f"{where}.{key}".removeprefix("."))
    elif isinstance(value, list):
        for number, item in enumerate(value):
            check_storable(item, f"{where}[{number}]")
    elif not isinstance(value, str) and not (isinstance(value, int | float) and abs(value) < inf):
        raise BadData(f"{where} is {value}, expected a finite number, true, false or a text")
