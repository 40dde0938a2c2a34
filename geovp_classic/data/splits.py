"""Splits of a data set by name: lists of frame ranges in TOML files, with a hash that results keep.

A split file holds `ranges = ["06", "03[180:360)"]` and may say `about = "..."`.
"""

import difflib
import hashlib
import tomllib
from collections.abc import Iterable
from pathlib import Path

from geovp_classic import files
from geovp_classic.data.windows import FrameRange
from geovp_classic.errors import BadData

_FOLDER = Path(__file__).with_name("named_splits")


def names() -> list[str]:
    """The names of the splits that come with the package, sorted."""
    return sorted(file.stem for file in _FOLDER.glob("*.toml"))


def load(name: str) -> tuple[FrameRange, ...]:
    """The ranges of a named split, or of a file when the name ends in .toml; BadData with the
    nearest name.
    """
    path = Path(name).expanduser() if name.endswith(".toml") else _FOLDER / f"{name}.toml"
    if not path.is_file():
        if name.endswith(".toml"):
            raise BadData(f"split file {path} does not exist")
        close = difflib.get_close_matches(name, names(), n=1, cutoff=0.5)
        hint = (
            f"did you mean {close[0]!r}?"
            if close
            else f"known are {', '.join(names())}, or give a .toml file"
        )
        raise BadData(f"no split is called {name!r}: {hint}")
    try:
        table = tomllib.loads(files.read_text(path))
    except (
        ValueError,
        RecursionError,
    ) as problem:  # TOMLDecodeError is a ValueError, 5,000 digits are another
        raise BadData(f"{path} is not TOML: {problem}") from problem
    ranges = table.get("ranges")
    if (
        not isinstance(ranges, list)
        or not ranges
        or not all(isinstance(text, str) for text in ranges)
    ):
        raise BadData(
            f'{path}: expected ranges = ["06", "03[180:360)"], a list of sequences or frame ranges'
        )
    unknown = sorted(table.keys() - {"ranges", "about"})
    if unknown or not isinstance(table.get("about", ""), str):
        raise BadData(
            f"{path}: {unknown[0] if unknown else 'about'!r} is not expected, only ranges and "
            'about = "..."'
        )
    return tuple(FrameRange.parse(text) for text in ranges)


def content_hash(ranges: Iterable[FrameRange]) -> str:
    """SHA-256 of the ranges in their order, one a line, as `FrameRange` writes them."""
    return hashlib.sha256("\n".join(map(str, ranges)).encode()).hexdigest()
