"""Who waits for a long piece of work is told how far it is."""

from __future__ import annotations

from collections.abc import Callable

Watch = Callable[[int, int], None]  # so many of so many are done


def unwatched(done: int, total: int) -> None:
    """Nobody looks on."""
