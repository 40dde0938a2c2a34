"""What a matrix file may say so that its results can be stored: values that JSON has, names for folders, sizes."""

from __future__ import annotations

import datetime
from collections.abc import Iterable
from typing import Any

from geovp_classic.errors import BadData

MAX_DEPTH = 32  # of tables in tables
MAX_NAME_BYTES = 200  # of 255 that file systems allow: scratch files have longer names
MAX_SIDE_PX = 8192
MAX_CLIP_PIXELS = 2**29  # 1.5 GiB of frames
FILES = ("protocol.json", "datasets.json", "cell.json", "report.html", ".lock")  # of a results folder


def check_values(value: Any, where: str = "", depth: int = 0) -> None:
    """BadData for what a results folder cannot store: dates, NaN and infinity, huge numbers, deep nesting."""
    if depth > MAX_DEPTH:
        raise BadData(f"{where[:60]}... is nested more than {MAX_DEPTH} tables deep: make it flatter")
    if isinstance(value, dict):
        for key, each in value.items():
            check_values(each, f"{where}.{key}".removeprefix("."), depth + 1)
    elif isinstance(value, list):
        for number, each in enumerate(value):
            check_values(each, f"{where}[{number}]", depth + 1)
    elif isinstance(value, datetime.date | datetime.time):
        raise BadData(f"{where} is {value}, a date or time, which no setting takes: put it in quotes if it is a text")
    elif isinstance(value, int | float) and not abs(value) < 2**63:
        given = value if isinstance(value, float) else "a number of more than 63 bits"
        raise BadData(f"{where} is {given}, expected a finite number: correct it or leave it out")


def check_names(names: list[str], folders: Iterable[str]) -> None:
    """BadData unless every row has a folder of its own, on every file system."""
    taken = [name.casefold() for name in (*FILES, *folders)]
    for name in names:
        if name.casefold() in taken:
            raise BadData(f"two folders of the results would be called {name!r}: rename an entry of the matrix file")
        if len(name.encode()) > MAX_NAME_BYTES:
            raise BadData(f"the row {name[:40]}... has a name of {len(name.encode())} bytes: {MAX_NAME_BYTES} at most")
        taken.append(name.casefold())


def check_clip(size_px: tuple[int, int], num_frames: int) -> None:
    """BadData when the frames of one clip would not fit into memory."""
    width_px, height_px = size_px
    if max(size_px) > MAX_SIDE_PX:
        raise BadData(f"protocol.size_px is {list(size_px)}, expected at most {MAX_SIDE_PX} pixels on a side")
    if width_px * height_px * num_frames > MAX_CLIP_PIXELS:
        given = f"{num_frames} frames of {width_px}x{height_px} pixels"
        raise BadData(f"a clip would have {given}: lower size_px, num_past or num_future")
