"""Splits of a data set by name: lists of frame ranges in TOML files, with a hash that results keep.

A split file holds `ranges = ["06", "03[180:360)"]` and may say `about = "..."`.
"""

import hashlib
import tomllib
from collections.abc import Iterable
from pathlib import Path

from geovp_classic import files
from geovp_classic.data.recordings.windows import FrameRange
from geovp_classic.errors import BadData, nearest

FOLDER = Path(__file__).with_name("named_splits")


def names() -> list[str]:
    """Return the names of the splits that come with the package, sorted."""
    return sorted(file.stem for file in FOLDER.glob("*.toml"))


def load(name: str) -> tuple[FrameRange, ...]:
    """Return the ranges of a named split, or of a file if the name ends in .toml."""
    path = FOLDER / f"{name}.toml"
    if name.endswith(".toml"):
        path = Path(name).expanduser()
    elif name not in names():
        message = f"no split is called {name!r}{nearest(name, names())}"
        raise BadData(f"{message} (or give a .toml file)")
    text = files.read_text(path)
    expected = 'expected ranges = ["06", "03[180:360)"] and perhaps about = "..."'
    with files.checked(f"{path} is not a list of frame ranges", expected):
        table = tomllib.loads(text)
        if not table["ranges"] or table.keys() - {"ranges", "about"}:
            raise BadData(f"it holds {list(table)}")
        return tuple(map(FrameRange.parse, table["ranges"]))


def content_hash(ranges: Iterable[FrameRange]) -> str:
    """Return the SHA-256 of the ranges in their order, one a line, as `FrameRange` writes them."""
    return hashlib.sha256("\n".join(map(str, ranges)).encode()).hexdigest()
