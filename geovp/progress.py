"""Progress of long work: what is done now, how much is done, and a progress bar that shows both.

Reports are log records, so that work need not know the bar.
"""

import logging
import sys
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any, TextIO, TypeVar

Item = TypeVar("Item")

logger = logging.getLogger("geovp")
steps = logging.getLogger("geovp.steps")
steps.setLevel(logging.DEBUG)  # the bar shows them however little is logged


def announce(step: str, done: int = 0) -> None:
    """Say what is done now, and how much of the bar was done just before it."""
    steps.debug(step, extra={"done": done})


def report(done: int, total: int) -> None:
    """Say how much of the work is done; another total restarts the bar."""
    steps.debug("%d of %d", done, total)


def tracked(items: Collection[Item]) -> Iterator[Item]:
    """Yield the items; report each as done when the next one is asked for."""
    for done, item in enumerate(items, 1):
        yield item
        report(done, len(items))


@contextmanager
def progress_bar(description: str, log_interval_s: float = 60.0) -> Iterator[None]:
    """Show a progress bar with the current step on standard error.

    Where standard error is not a terminal, a line a minute is logged instead; with --quiet, nothing
    is shown. The bar is drawn by the calling thread alone: another thread could hold its lock when
    standard error breaks.
    """
    is_drawn = sys.stderr.isatty() and logger.isEnabledFor(logging.WARNING)
    with _bar(description) if is_drawn else nullcontext() as bar:
        logged_s = time.monotonic()

        def show(record: logging.LogRecord) -> bool:
            nonlocal logged_s
            if bar is not None:
                _draw(bar, record)
            elif record.args and time.monotonic() - logged_s >= log_interval_s:
                logged_s = time.monotonic()
                logger.warning("%s: %s of %s", description, *record.args)
            return True

        steps.addFilter(show)
        try:
            yield
        finally:
            steps.removeFilter(show)
            if bar is not None:
                bar.set_postfix_str("", refresh=False)


def _bar(description: str) -> Any:
    from tqdm import tqdm  # which a log does not need, and a tenth of the time of a table

    tqdm.monitor_interval = 0  # no thread of tqdm
    return tqdm(
        total=0,
        desc=description,
        bar_format="{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} "
        "[{elapsed}<{remaining}{postfix}]",
        file=sys.stderr,
        delay=0.5,
    )


def _draw(bar: Any, record: logging.LogRecord) -> None:
    """Show a report, which is a count, or an announcement, which is a step."""
    if record.args:
        done, total = record.args
        if total != bar.total:
            bar.reset(total)
        bar.update(done - bar.n)
    else:
        bar.set_postfix_str(record.msg, refresh=False)
        bar.update(min(vars(record)["done"], max(0, bar.total - bar.n)))


def print_line(line: str, file: TextIO) -> None:
    """Print a line above the progress bar, if there is one."""
    module = sys.modules.get("tqdm")  # loaded where a bar is drawn
    if module:
        module.tqdm.write(line, file=file)
    else:
        file.write(f"{line}\n")
