"""Progress of long work: the callback, what is being done now, and a progress bar
that shows both.
"""

import logging
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

Item = TypeVar("Item")
Progress = Callable[[int, int], None]  # (done, total)
FIRST_SHOWN_S, REFRESHED_S = 0.5, 1.0
BAR = (
    "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} {unit} [{elapsed}<{remaining}{postfix}]"
)

logger = logging.getLogger("geovp_benchmarks")
steps = logging.getLogger("geovp_benchmarks.steps")
steps.setLevel(logging.DEBUG)  # the bar shows them however little is logged


def no_progress(done: int, total: int) -> None:
    """Show nothing."""


def announce(step: str, done: int = 0) -> None:
    """Say what is done now, and how much of the bar was done just before it."""
    steps.debug(step, extra={"done": done})


def tracked(items: Iterable[Item], total: int, progress: Progress) -> Iterator[Item]:
    """The items; each is reported as done when the next one is asked for."""
    for done, item in enumerate(items, 1):
        yield item
        progress(done, total)


@contextmanager
def progress_bar(description: str, unit: str) -> Iterator[Progress]:
    """A Progress that shows a bar on standard error, once the work takes half a second; none with
    --quiet.
    """
    from tqdm import tqdm

    is_quiet = not logger.isEnabledFor(logging.WARNING)
    with tqdm(
        total=0,
        desc=description,
        unit=unit,
        bar_format=BAR,
        file=sys.stderr,
        delay=FIRST_SHOWN_S,
        disable=is_quiet,
    ) as bar:
        ended = threading.Event()
        clock = threading.Thread(target=_refresh, args=(bar, ended), daemon=True)
        listener = _Listener(bar)
        steps.addHandler(listener)
        clock.start()

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        try:
            yield show
        finally:
            steps.removeHandler(listener)
            ended.set()
            clock.join()
            bar.set_postfix_str("", refresh=False)


class _Listener(logging.Handler):
    """Shows announced steps behind a bar."""

    def __init__(self, bar: Any) -> None:  # tqdm
        super().__init__()
        self._bar = bar

    def emit(self, record: logging.LogRecord) -> None:
        self._bar.set_postfix_str(record.getMessage(), refresh=False)
        done = int(getattr(record, "done", 0))
        if done:
            self._bar.update(min(done, max(0, (self._bar.total or 0) - self._bar.n)))


def _refresh(bar: Any, ended: threading.Event) -> None:
    """Show the bar before its first step is done, and on a terminal go on so that its clock does
    not stand still.
    """
    wait_s = FIRST_SHOWN_S
    while not ended.wait(wait_s):
        bar.delay = 0  # it is shown now, so its line has to be ended
        bar.refresh()
        wait_s = REFRESHED_S if sys.stderr.isatty() else threading.TIMEOUT_MAX
