"""Messages of a command: log records on standard error, and the width of printed tables."""

import logging
import os
import shutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress

from geovp.progress import print_line

logger = logging.getLogger(__name__)


class StandardError(logging.Handler):
    """Handler that prints a line `geovp: ...`, above a progress bar if there is one."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record; a closed or full stream does not end the command."""
        with suppress(OSError, ValueError):
            print_line(f"geovp: {self.format(record)}", sys.stderr)


@contextmanager
def messages(is_quiet: bool, is_verbose: bool) -> Iterator[None]:
    """Print the log while a command runs."""
    level = logging.ERROR if is_quiet else logging.INFO if is_verbose else logging.WARNING
    handler, root = StandardError(level), logging.getLogger()
    previous = root.level
    root.addHandler(handler)
    root.setLevel(level)
    try:
        yield
    finally:
        root.removeHandler(handler)
        root.setLevel(previous)


def print_notes(lines: Iterable[str]) -> None:
    """Print lines on standard error; a closed or full stream does not end the command."""
    with suppress(OSError, ValueError):
        print(*lines, sep="\n", file=sys.stderr)


def terminal_width() -> int | None:
    """Return the number of columns for tables, at most 120; None if the output is redirected."""
    if not sys.stdout.isatty() and "COLUMNS" not in os.environ:
        return None
    return min(120, shutil.get_terminal_size((120, 24)).columns)
