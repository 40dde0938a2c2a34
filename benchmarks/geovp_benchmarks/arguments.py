"""Arguments that several verbs and studies take."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

FIGURES = (".png", ".pdf", ".svg")


def at_least(least: int, kind: type[int] | type[float] = int) -> Callable[[str], Any]:
    """The type of a finite number that is no less."""

    def number(text: str) -> int | float:
        value = kind(text)
        if not least <= value < math.inf:
            raise argparse.ArgumentTypeError(
                f"{text} is not a {'whole ' * (kind is int)}number of {least} or more"
            )
        return value

    return number


positive = at_least(1)


def figure_file(text: str) -> Path:
    """The type of a file that a figure is drawn into."""
    path = Path(text)
    if path.suffix not in FIGURES or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(
            f"{text} is not a file {', '.join(FIGURES)} in a folder that exists"
        )
    return path
