"""Argument types of several commands and studies."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

FIGURES = (".png", ".pdf", ".svg")


def at_least(minimum: int, kind: type[int] | type[float] = int) -> Callable[[str], Any]:
    """Return the type of an argument: a finite number of at least `minimum`."""

    def number(text: str) -> int | float:
        value = kind(text)
        if not minimum <= value < math.inf:
            raise argparse.ArgumentTypeError(
                f"{text} is not a {'whole ' * (kind is int)}number of {minimum} or more"
            )
        return value

    return number


positive = at_least(1)


def figure_file(text: str) -> Path:
    """Return the path of a figure; raise ArgumentTypeError if it cannot be written."""
    path = Path(text)
    if path.suffix not in FIGURES or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(
            f"{text} is not a file {', '.join(FIGURES)} in a folder that exists"
        )
    return path
