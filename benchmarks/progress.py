"""Progress of long work: the callback, and a progress bar that is one."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")
Progress = Callable[[int, int], None]  # (done, total)


def no_progress(done: int, total: int) -> None:
    """Show nothing."""


def tracked(items: Iterable[Item], total: int, progress: Progress) -> Iterator[Item]:
    """The items; each is reported as done when the next one is asked for."""
    for done, item in enumerate(items, 1):
        yield item
        progress(done, total)


@contextmanager
def progress_bar(description: str, unit: str) -> Iterator[Progress]:
    """A Progress that shows a bar on standard error, once the work takes half a second."""
    from tqdm import tqdm

    with tqdm(total=0, desc=description, unit=f" {unit}", file=sys.stderr, delay=0.5) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield show
