"""How fast things are; to be run by hand on a quiet machine, never asserted in a test."""

import argparse
import time
from collections.abc import Callable
from typing import TypeVar

from geovp_benchmarks.arguments import positive

Seconds = tuple[float, float]  # wall clock, and CPU time of all threads
Result = TypeVar("Result")


def timed(work: Callable[[], Result]) -> tuple[Result, Seconds]:
    """The result of the work, and its processing time."""
    clock, processor = time.perf_counter(), time.process_time()
    result = work()
    return result, (time.perf_counter() - clock, time.process_time() - processor)


def rounds_parser(description: str, default: int) -> argparse.ArgumentParser:
    """A parser of the number of rounds."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("rounds", nargs="?", type=positive, default=default, metavar="ROUNDS")
    return parser
