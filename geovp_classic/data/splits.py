"""Splits of a data set by name: lists of frame ranges in TOML files, with a hash that results keep.

A split file holds `ranges = ["06", "03[180:360)"]` and may say `about = "..."`.
"""

import hashlib
import tomllib
from collections.abc import Iterable
from pathlib import Path

from geovp_classic import files
from geovp_classic.data.windows import FrameRange
from geovp_classic.errors import BadData, nearest


def names() -> list[str]:
    """Return the names of the splits that come with the package, sorted."""
    return sorted(file.stem for file in _folder().glob("*.toml"))


def load(name: str) -> tuple[FrameRange, ...]:
    """Return the ranges of a named split, or of a file if the name ends in .toml."""
    path = _folder() / f"{name}.toml"
    if name.endswith(".toml"):
        path = Path(name).expanduser()
    elif name not in names():
        message = f"no split is called {name!r}{nearest(name, names())}"
        raise BadData(f"{message} (or give a .toml file)")
    text = files.read_text(path)
    try:
        table = tomllib.loads(text)
    except (
        ValueError,
        RecursionError,
    ) as problem:  # 5,000 digits are a ValueError, too
        raise BadData(f"{path} is not TOML: {problem}") from problem
    ranges = table.get("ranges")
    is_list = isinstance(ranges, list) and all(
        isinstance(text, str) for text in ranges
    )
    if not ranges or not is_list or table.keys() - {"ranges", "about"}:
        raise BadData(
            f'{path} holds {list(table)}: expected ranges = ["06", "03[180:360)"], a list of '
            'sequences or frame ranges, and perhaps about = "..."'
        )
    return tuple(map(FrameRange.parse, ranges))


def content_hash(ranges: Iterable[FrameRange]) -> str:
    """Return the SHA-256 of the ranges in their order, one a line, as `FrameRange` writes them."""
    return hashlib.sha256("\n".join(map(str, ranges)).encode()).hexdigest()


def _folder() -> Path:
    return Path(__file__).with_name("named_splits")
