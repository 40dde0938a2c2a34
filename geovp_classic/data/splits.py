"""Splits of a data set by name: lists of frame ranges in TOML files, with a hash that results keep.

A split file holds `ranges = ["06", "03[180:360)"]` and may say `about = "..."`.
"""

from __future__ import annotations

import difflib
import hashlib
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from geovp_classic.data.windows import FrameRange
from geovp_classic.errors import BadData

_FOLDER = Path(__file__).with_name("named_splits")


@dataclass(frozen=True)
class Split:
    """Frame ranges under a name."""

    name: str
    ranges: tuple[FrameRange, ...]
    about: str = ""


def names() -> list[str]:
    """The names of the splits that come with the package, sorted."""
    return sorted(file.stem for file in _FOLDER.glob("*.toml"))


def load(name: str) -> Split:
    """The split of a name, or of a file when the name ends in .toml; BadData with the nearest name."""
    if name.endswith(".toml"):
        path = Path(name).expanduser()
        if not path.is_file():
            raise BadData(f"split file {path} does not exist")
    elif name in names():
        path = _FOLDER / f"{name}.toml"
    else:
        close = difflib.get_close_matches(name, names(), n=1, cutoff=0.5)
        hint = f"did you mean {close[0]!r}?" if close else f"known are {', '.join(names())}, or give a .toml file"
        raise BadData(f"no split is called {name!r}: {hint}")
    return parse(path.stem, path.read_bytes(), str(path))


def parse(name: str, content: bytes, where: str) -> Split:
    """The split that a TOML text describes; BadData names `where` it came from."""
    try:
        table = tomllib.loads(content.decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise BadData(f"{where} is not TOML: {problem}") from problem
    ranges, about = table.get("ranges"), table.get("about", "")
    if not isinstance(ranges, list) or not ranges or not all(isinstance(text, str) for text in ranges):
        raise BadData(f'{where}: expected ranges = ["06", "03[180:360)"], a list of sequences or frame ranges')
    unknown = sorted(table.keys() - {"ranges", "about"})
    if unknown or not isinstance(about, str):
        raise BadData(f'{where}: {unknown[0] if unknown else "about"!r} is not expected, only ranges and about = "..."')
    return Split(name, tuple(FrameRange.parse(text) for text in ranges), about)


def content_hash(ranges: Iterable[FrameRange]) -> str:
    """SHA-256 of the ranges in their order, one a line, as `FrameRange` writes them; names and comments don't count."""
    return hashlib.sha256("\n".join(map(str, ranges)).encode()).hexdigest()
