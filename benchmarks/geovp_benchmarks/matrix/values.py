"""Types of the values in a matrix file."""

import re
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from geovp_benchmarks.matrix import DEVICE


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
    named = {table["name"]: table for table in tables}
    if len(named) < len(tables):
        raise ValueError(
            'expected each name once: give tables such as { psnr-2 = { name = "psnr" } }'
        )
    return named


def _folder_name(name: str) -> str:
    """Return the name of a folder; that of a method has two, and file systems allow 255 bytes."""
    if not re.fullmatch(r"[A-Za-z0-9_+=,][A-Za-z0-9_+=,.-]{0,95}", name):
        raise ValueError(
            "expected a name of up to 96 letters, digits and _ + = , . - without spaces"
        )
    return name


def _device(text: str) -> str:
    """Return the name of a device."""
    if not DEVICE.fullmatch(text):
        raise ValueError("expected cpu, cuda, cuda:N or auto")
    return text


def _pair(value: Any) -> Any:
    """Return two numbers."""
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise ValueError("expected [width, height] in pixels")
    return value


IsNamed = BeforeValidator(_named)
Spec = Annotated[dict[str, Any], IsNamed]  # {"name": ..., **fields}, as `registry.build` takes it
FolderName = Annotated[str, AfterValidator(_folder_name)]
Specs = Annotated[dict[FolderName, Spec], BeforeValidator(_by_name)]  # columns have files, too
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Device = Annotated[str, AfterValidator(_device)]
Pixels = Annotated[int, Field(strict=True, ge=1, le=10_000)]
Size = Annotated[tuple[Pixels, Pixels], BeforeValidator(_pair)]  # width, height
