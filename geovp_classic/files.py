"""Checked reading of files: a missing, too large or damaged file raises BadData in one sentence."""

import contextlib
import io
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from geovp_classic.errors import BadData

MIB = 2**20
PACKAGED = Path(__file__).with_name("poses")  # coefficients of forecasters


@contextlib.contextmanager
def opened(path: Path) -> Iterator[io.BufferedReader]:
    """Open a regular file; raise BadData if it cannot be opened or reading it fails."""
    try:
        if path.exists() and not path.is_file():
            kind = "folder" if path.is_dir() else "pipe or device"
            raise BadData(f"{path} is a {kind}, expected a file: give a file on disk")
        with path.open("rb") as file:
            yield file
    except (OSError, ValueError) as problem:  # ValueError: a NUL in the name
        reason = getattr(problem, "strerror", None) or problem
        raise BadData(
            f"{path} cannot be read ({reason}): restore it or its permissions, or give another"
        ) from problem


@contextlib.contextmanager
def checked(what: str, advice: str) -> Iterator[None]:
    """Raise BadData with the reason, between `what` and `advice`, in place of any exception.

    Libraries raise a dozen types for damaged files.
    """
    try:
        yield
    except Exception as problem:
        reason = str(getattr(problem, "strerror", None) or problem).strip()
        # pycolmap names a line of C++, and Pillow an open file
        reason = re.sub(r"^\[\w+\.\w+:\d+\] | <_io\.[^>]+>", "", reason)
        reason = reason.partition("\n")[0][:200] or type(problem).__name__
        raise BadData(f"{what} ({reason}): {advice}") from problem


def read_bytes(path: Path, limit_bytes: int = 256 * MIB) -> bytes:
    """Read a regular file of at most `limit_bytes`."""
    with opened(path) as file:
        content = file.read(limit_bytes + 1)
    if len(content) > limit_bytes:
        raise BadData(
            f"{path} has more than {limit_bytes // MIB} MiB, the limit of such files: give the "
            "right file"
        )
    return content


def read_text(path: Path, limit_bytes: int = 64 * MIB) -> str:
    """Read a text file in UTF-8."""
    content = read_bytes(path, limit_bytes)
    with checked(f"{path} cannot be read as text", "give a file in UTF-8"):
        return content.decode("utf-8-sig")


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON file that holds an object."""
    text = read_text(path)
    with checked(f"{path} is not JSON", "fix or remove it"):
        content = json.loads(text)
        if isinstance(content, dict):
            return content
        raise ValueError(f"{type(content).__name__} instead of an object")


def json_bytes(value: Mapping[str, Any]) -> bytes:
    """Encode an object as a JSON file; raise BadData for a path or name that is not UTF-8."""
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
    advice = "give folders and files other names"
    with checked("a path or name is not text in UTF-8", advice):
        return f"{text}\n".encode()


def read_npz(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Read the arrays of an npz file after checking the checksum of each; never unpickle."""
    content = read_bytes(path, 8192 * MIB)
    with (
        checked(f"{path} cannot be read", "it is not a whole npz file"),
        np.load(io.BytesIO(content), allow_pickle=False) as archive,
    ):
        if damaged := archive.zip.testzip():
            raise ValueError(f"the checksum of {damaged} is wrong")
        return dict(archive)


def leads_inside(name: str) -> bool:
    """Return whether a relative path from data stays inside its folder."""
    path = Path(name)
    return not path.is_absolute() and ".." not in path.parts and "\0" not in name


def check_name(name: str, what: str) -> None:
    """Raise BadData unless a name is one line of UTF-8 and stays inside its folder."""
    if re.search(r"[\ud800-\udfff\0\n\r]", name):
        raise BadData(f"{what} {name!r} is not text in UTF-8 on one line: rename it")
    if not leads_inside(name):
        raise BadData(f"{what} {name!r} leads out of its folder: give a path inside it")
