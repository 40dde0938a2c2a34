"""The values of a matrix file: of the right kind, and such that its results can be stored; BadData
for others.
"""

import datetime
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from geovp_benchmarks.cli.arguments import DEVICE
from geovp_classic import registry
from geovp_classic.errors import BadData, UnknownComponent

Spec = Mapping[str, Any]  # {"name": ..., **fields}, as `registry.build` takes it

MAX_DEPTH = 32  # of tables in tables
MAX_NAME_BYTES = 200  # of 255 that file systems allow: scratch files have longer names
MAX_SIDE_PX = 8192
MAX_CLIP_PIXELS = 2**29  # 1.5 GiB of frames
FILES = (
    "protocol.json",
    "datasets.json",
    "cell.json",
    "report.html",
    ".lock",
)  # of a results folder


def check_values(value: Any, where: str = "", depth: int = 0) -> None:
    """BadData for what a results folder cannot store: dates, NaN and infinity, huge numbers, deep
    nesting.
    """
    if depth > MAX_DEPTH:
        raise BadData(
            f"{where[:60]}... is nested more than {MAX_DEPTH} tables deep: make it flatter"
        )
    if isinstance(value, dict):
        for key, each in value.items():
            check_values(each, f"{where}.{key}".removeprefix("."), depth + 1)
    elif isinstance(value, list):
        for number, each in enumerate(value):
            check_values(each, f"{where}[{number}]", depth + 1)
    elif isinstance(value, datetime.date | datetime.time):
        raise BadData(
            f"{where} is {value}, a date or time, which no setting takes: put it in quotes if "
            "it is a text"
        )
    elif isinstance(value, int | float) and not abs(value) < 2**63:
        given = value if isinstance(value, float) else "a number of more than 63 bits"
        raise BadData(f"{where} is {given}, expected a finite number: correct it or leave it out")


def check_names(names: list[str], folders: Iterable[str]) -> None:
    """BadData unless every row has a folder of its own, on every file system."""
    taken = [name.casefold() for name in (*FILES, *folders)]
    for name in names:
        if name.casefold() in taken:
            raise BadData(
                f"two folders of the results would be called {name!r}: rename an entry of the "
                "matrix file"
            )
        if len(name.encode()) > MAX_NAME_BYTES:
            raise BadData(
                f"the method {name[:40]}... has a name of {len(name.encode())} bytes: "
                f"{MAX_NAME_BYTES} at most"
            )
        taken.append(name.casefold())


def check_clip(size_px: tuple[int, int], num_frames: int) -> None:
    """BadData when the frames of one clip would not fit into memory."""
    width_px, height_px = size_px
    if max(size_px) > MAX_SIDE_PX:
        raise BadData(
            f"protocol.size_px is {list(size_px)}, expected at most {MAX_SIDE_PX} pixels on a side"
        )
    if width_px * height_px * num_frames > MAX_CLIP_PIXELS:
        given = f"{num_frames} frames of {width_px}x{height_px} pixels"
        raise BadData(f"a clip would have {given}: lower size_px, num_past or num_future")


def table(content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """A table of tables or values; empty where there is none."""
    value = content.get(key, {})
    if not isinstance(value, Mapping):
        raise BadData(f"{key} is {value!r}, expected a table [{key}]")
    return value


def only(given: Iterable[str], known: Sequence[str], where: str, what: str) -> None:
    """UnknownComponent for a word that is none of the known ones."""
    for key in given:
        if key not in known:
            raise UnknownComponent(
                f"{where} has an unknown {what} {key!r}{registry.nearest(key, known)}"
            )


def spec(value: Any, where: str) -> Spec:
    """A component, by its name or its table."""
    found = {"name": value} if isinstance(value, str) else value
    if not isinstance(found, Mapping) or not isinstance(found.get("name"), str):
        raise BadData(f'{where} is {value!r}, expected a table such as {{ name = "..." }}')
    return found


def named_specs(value: Any, where: str) -> dict[str, Spec]:
    """Components by the name of their column or folder: a list of names and tables, or a table of
    named tables.
    """
    if isinstance(value, Mapping):
        return {name: spec(each, f"{where}.{name}") for name, each in value.items()}
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise BadData(f'{where} is {value!r}, expected a list such as ["psnr", "ssim"]')
    found: dict[str, Spec] = {}
    for number, each in enumerate(value):
        one = spec(each, f"{where}[{number}]")
        name = one["name"]
        if name in found:
            raise BadData(
                f"{where} has {name!r} twice: give a table, such as "
                f"{{ other = {{ name = {name!r} }} }}"
            )
        found[name] = one
    return found


def count(given: Mapping[str, Any], key: str, where: str, default: int | None = None) -> int:
    """A whole number of 1 or more; needed where there is no default."""
    value = given.get(key, default)
    if value is None:
        raise BadData(f"{where} needs {key}, a whole number: add it to the matrix file")
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise BadData(f"{where}.{key} is {value!r}, expected a whole number of 1 or more")
    return value


def size(protocol: Mapping[str, Any]) -> tuple[int, int]:
    """Width and height in pixels."""
    value = protocol.get("size_px")
    if (
        not isinstance(value, list)
        or len(value) != 2
        or not all(type(n) is int and n > 0 for n in value)
    ):
        raise BadData(
            f"protocol.size_px is {value!r}, expected [width, height] in pixels, such as [256, 256]"
        )
    return value[0], value[1]


def device(protocol: Mapping[str, Any]) -> str | None:
    """The device of networks, where one is given."""
    value = protocol.get("device")
    if value is None or (isinstance(value, str) and DEVICE.fullmatch(value)):
        return value
    raise BadData(f"protocol.device is {value!r}, expected cpu, cuda, cuda:N or auto")
