"""The main function of `python -m benchmarks.performance.NAME`: a text to print, or one sentence and exit code 2."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence

from geovp_classic.errors import BadData, GeovpError


def command(text: Callable[[Sequence[str]], str]) -> Callable[[Sequence[str]], int]:
    """A `main` that prints what the function makes of the arguments and gives the exit code."""

    @functools.wraps(text)
    def main(arguments: Sequence[str]) -> int:
        try:
            sys.stdout.write(text(arguments) + "\n")
        except GeovpError as error:
            sys.stderr.write(f"{error}\n")
            return 2
        return 0

    return main


def whole_numbers(arguments: Sequence[str], defaults: Sequence[int], usage: str) -> list[int]:
    """As many numbers as there are defaults, which stand for those not given; BadData for anything else.

    Numbers are at least 1, but where the default is 0.
    """
    if len(arguments) > len(defaults) or not all(word.isdecimal() for word in arguments):
        raise BadData(f"arguments {' '.join(arguments)!r}: expected {usage}, whole numbers")
    numbers = [int(word) for word in arguments] + list(defaults)[len(arguments) :]
    if any(number < min(default, 1) for number, default in zip(numbers, defaults, strict=True)):
        raise BadData(f"arguments {' '.join(arguments)!r}: expected {usage}, counts of at least 1")
    return numbers
