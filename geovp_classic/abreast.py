"""Pictures side by side: OpenCV and numpy let other threads work while they do, so that each core takes a picture."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numba

Task = TypeVar("Task")
Result = TypeVar("Result")


def abreast(work: Callable[[Task], Result], tasks: Iterable[Task]) -> list[Result]:
    """The results in the order of the tasks; the work must not start compiled code that is parallel itself."""
    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        return list(pool.map(work, tasks))
