"""Measurements of speed, to be run by hand on a quiet machine; no test asserts them.

The package is not installed: run it from the repository root with `benchmarks` on the path, as
`PYTHONPATH=benchmarks python -m performance`.
"""

import argparse
import time
from collections.abc import Callable
from typing import TypeVar

from geovp_benchmarks.arguments import positive

Seconds = tuple[float, float]  # wall clock, and CPU time of all threads
Result = TypeVar("Result")

COMMAND = "PYTHONPATH=benchmarks python -m"  # from the repository root


def timed(work: Callable[[], Result]) -> tuple[Result, Seconds]:
    """Return the result of the work, and its processing time."""
    clock, processor = time.perf_counter(), time.process_time()
    result = work()
    return result, (time.perf_counter() - clock, time.process_time() - processor)


def rounds_parser(module: str, description: str, default: int) -> argparse.ArgumentParser:
    """Return a parser of the number of rounds, for `python -m` with the module's name."""
    parser = argparse.ArgumentParser(prog=f"{COMMAND} {module}", description=description)
    parser.add_argument(
        "rounds",
        nargs="?",
        type=positive,
        default=default,
        metavar="ROUNDS",
        help=f"Number of rounds after the warm-up. Default: {default}.",
    )
    return parser
