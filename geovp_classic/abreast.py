"""Pictures side by side: OpenCV and numpy let other threads work while they do, so that each core takes a picture.

Linear algebra on small matrices gains nothing from more threads, and loses by them: those of OpenBLAS wait for the next
product with the processor busy, for some hundredths of a second after each, and hold the cores that others need.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar

import numba
from threadpoolctl import ThreadpoolController

Task = TypeVar("Task")
Result = TypeVar("Result")
Given = ParamSpec("Given")


def abreast(work: Callable[[Task], Result], tasks: Iterable[Task]) -> list[Result]:
    """The results in the order of the tasks; the work must not start compiled code that is parallel itself."""
    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        return list(pool.map(work, tasks))


def unhindered(work: Callable[Given, Result]) -> Callable[Given, Result]:
    """The same work, with linear algebra kept to one thread meanwhile (in the whole process)."""

    @functools.wraps(work)
    def alone(*given: Given.args, **named: Given.kwargs) -> Result:
        with _libraries().limit(limits=1, user_api="blas"):
            return work(*given, **named)

    return alone


@functools.cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()
