"""Types of the values in a matrix file."""

from collections.abc import Mapping
from math import inf
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from geovp_benchmarks.matrix import DEVICE
from geovp_classic.errors import BadData


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
Count = Annotated[int, Field(strict=True, ge=1, lt=2**31)]
Device = Annotated[str, Field(pattern=DEVICE)]
# The name of a method has two of these, and file systems allow 255 bytes.
FolderName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_+=,][A-Za-z0-9_+=,.-]{0,95}$")]
Size = tuple[Count, Count]  # width, height


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
