"""Progress of long work: what is done now, how much is done, and a progress bar that shows both.

Reports are log records, so that work need not know the bar.
"""

import logging
import sys
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import TypeVar

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
    is shown. The bar is drawn by the
    calling thread alone: another thread could hold its lock when standard error breaks.
    """
    from tqdm import tqdm

    tqdm.monitor_interval = 0  # no thread of tqdm either
    is_quiet = not logger.isEnabledFor(logging.WARNING)
    with tqdm(
        total=0,
        desc=description,
        bar_format="{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} "
        "[{elapsed}<{remaining}{postfix}]",
        file=sys.stderr,
        delay=0.5,
        disable=is_quiet or not sys.stderr.isatty(),
    ) as bar:
        # Reports are counts, announcements are steps.
        logged_s = time.monotonic()

        def show(record: logging.LogRecord) -> bool:
            nonlocal logged_s
            if record.args:
                done, total = record.args
                if not sys.stderr.isatty() and time.monotonic() - logged_s >= log_interval_s:
                    logged_s = time.monotonic()
                    logger.warning("%s: %s of %s", description, done, total)
                if total != bar.total:
                    bar.reset(total)
                bar.update(done - bar.n)
            else:
                bar.set_postfix_str(record.msg, refresh=False)
                bar.update(min(vars(record)["done"], max(0, bar.total - bar.n)))
            return True

        steps.addFilter(show)
        try:
            yield
        finally:
            steps.removeFilter(show)
            bar.set_postfix_str("", refresh=False)
