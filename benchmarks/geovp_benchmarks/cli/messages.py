"""What a verb says beside its results: on standard error, as much as `--quiet` or `--verbose` asks
for.
"""

import logging
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

PACKAGES = ("geovp_classic", "geovp_benchmarks", "geovp_learned")
LEVELS = {"quiet": logging.ERROR, "normal": logging.WARNING, "verbose": logging.INFO}
WIDEST = 120  # columns of what is printed on a terminal

say = logging.getLogger("geovp_benchmarks.cli")


class _Handler(logging.Handler):
    """A line `geovp: ...` on standard error, above a progress bar if there is one.

    A message that nobody can read any more does not end the work.
    """

    def emit(self, record: logging.LogRecord) -> None:
        tqdm = sys.modules.get("tqdm")
        write = tqdm.tqdm.write if tqdm is not None else print
        with suppress(OSError, ValueError):
            write(f"geovp: {self.format(record)}", file=sys.stderr)


@contextmanager
def messages(amount: str) -> Iterator[None]:
    """Show the packages' log, as much of it as one of LEVELS says, while a verb runs."""
    handler = _Handler(LEVELS[amount])
    loggers = [logging.getLogger(package) for package in PACKAGES]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(LEVELS[amount])
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)


def width() -> int | None:
    """How wide what is printed may be: at most WIDEST on a terminal or where COLUMNS says so; None
    for any width.
    """
    if (sys.stdout is None or not sys.stdout.isatty()) and "COLUMNS" not in os.environ:
        return None
    return min(WIDEST, shutil.get_terminal_size((WIDEST, 24)).columns)
