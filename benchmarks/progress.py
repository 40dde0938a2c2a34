"""A progress bar on standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable


class Bar:
    """A progress bar on standard error that appears only when there is something to wait for."""

    def __init__(self, what: str, unit: str) -> None:
        """`what` is being done, counted in `unit`."""
        self._what, self._unit = what, unit
        self._update: Callable[[int], object] | None = None
        self._close: Callable[[], object] | None = None
        self._shown = 0

    def show(self, done: int, total: int) -> None:
        """So many are done."""
        if self._update is None and total:
            from tqdm import tqdm

            bar = tqdm(total=total, desc=self._what, unit=f" {self._unit}", file=sys.stderr, delay=0.5)
            self._update, self._close = bar.update, bar.close
        if self._update is not None:
            self._update(done - self._shown)
            self._shown = done

    def __enter__(self) -> Bar:
        """Begin."""
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Leave the last state on the screen."""
        if self._close is not None:
            self._close()
