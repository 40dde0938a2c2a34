"""Exceptions; a message states what was given, what was expected and what to do."""

import difflib
from collections.abc import Iterable


class GeovpError(Exception):
    """Base of all errors that a user can correct; the command line prints them in one line."""


class BadData(GeovpError):
    """Invalid file, folder, array or setting."""


class Incompatible(GeovpError):
    """Components that cannot work together or with a clip; the method is skipped."""


class UnknownComponent(GeovpError):
    """Unregistered name of a component; the message suggests the nearest name."""


class MissingExtra(GeovpError):
    """Registered component with a requirement that is not installed or not on disk."""


def check_kind(name: str, value: object, kinds: type | tuple[type, ...], expected: str) -> None:
    """Raise BadData unless an argument is of one of the kinds."""
    if not isinstance(value, kinds):
        given = " ".join(repr(value).split())  # arrays have several lines
        raise BadData(f"{name} is {given:.100}, expected {expected}")


def install_command(extra: str) -> str:
    """Return the pip command that installs an extra of this package."""
    return f"pip install 'geovp[{extra}]'"


def nearest(word: str, words: Iterable[str]) -> str:
    """Return the end of a message: the nearest of the words, or all of them."""
    words = sorted({*words})
    if close := difflib.get_close_matches(word, words, n=1, cutoff=0.5):
        return f": did you mean {close[0]!r}?"
    return f": known are {', '.join(words) or 'none'}"
