"""Progress of long work: the callback, what is being done now, and a progress bar
that shows both.
"""

import logging
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")
Progress = Callable[[int, int], None]  # (done, total)
FIRST_SHOWN_S = 0.5
BAR = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} [{elapsed}<{remaining}{postfix}]"

logger = logging.getLogger("geovp_benchmarks")
steps = logging.getLogger("geovp_benchmarks.steps")
steps.setLevel(logging.DEBUG)  # the bar shows them however little is logged


def no_progress(done: int, total: int) -> None:
    """Show nothing."""


def announce(step: str, done: int = 0) -> None:
    """Say what is done now, and how much of the bar was done just before it."""
    steps.debug(step, extra={"done": done})


def tracked(items: Iterable[Item], total: int, progress: Progress) -> Iterator[Item]:
    """Yield the items; report each as done when the next one is asked for."""
    for done, item in enumerate(items, 1):
        yield item
        progress(done, total)


@contextmanager
def progress_bar(description: str) -> Iterator[Progress]:
    """Show a progress bar with the current step on standard error; another total restarts it.

    Nothing is shown with --quiet or where standard error is not a terminal. The bar is drawn by the
    calling thread alone: another thread could hold its lock when standard error breaks.
    """
    from tqdm import tqdm

    tqdm.monitor_interval = 0  # no thread of tqdm either
    is_quiet = not logger.isEnabledFor(logging.WARNING)
    with tqdm(
        total=0,
        desc=description,
        bar_format=BAR,
        file=sys.stderr,
        delay=FIRST_SHOWN_S,
        disable=is_quiet or not sys.stderr.isatty(),
    ) as bar:

        def show(done: int, total: int) -> None:
            if total != bar.total:
                bar.reset(total)
            bar.update(done - bar.n)

        def show_step(record: logging.LogRecord) -> bool:
            done = int(getattr(record, "done", 0))
            bar.set_postfix_str(record.getMessage(), refresh=False)
            bar.update(min(done, max(0, bar.total - bar.n)))
            return True

        steps.addFilter(show_step)
        try:
            yield show
        finally:
            steps.removeFilter(show_step)
            bar.set_postfix_str("", refresh=False)
