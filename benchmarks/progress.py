"""Progress of long work: the type of the callback, and a bar that can be one."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

Item = TypeVar("Item")
Progress = Callable[[int, int], None]  # (done, total)


def no_progress(done: int, total: int) -> None:
    """Show nothing."""


def tracked(items: Iterable[Item], total: int, progress: Progress) -> Iterator[Item]:
    """The items; each is reported as done when the next one is asked for."""
    for done, item in enumerate(items, 1):
        yield item
        progress(done, total)


class Bar:
    """A progress bar on standard error that appears only when there is something to wait for."""

    def __init__(self, what: str, unit: str) -> None:
        """`what` is being done, counted in `unit`."""
        self._what, self._unit = what, unit
        self._bar: Any = None

    def show(self, done: int, total: int) -> None:
        """A Progress."""
        if self._bar is None and total:
            from tqdm import tqdm

            self._bar = tqdm(total=total, desc=self._what, unit=f" {self._unit}", file=sys.stderr, delay=0.5)
        if self._bar is not None:
            self._bar.total = total
            self._bar.update(done - self._bar.n)

    def __enter__(self) -> Bar:
        """Begin."""
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Leave the last state on the screen."""
        if self._bar is not None:
            self._bar.close()
