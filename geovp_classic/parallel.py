"""Images side by side: OpenCV and numpy let other threads work while they do, so that each core takes an image.

Linear algebra on small matrices gains nothing from more threads, and loses by them: those of OpenBLAS wait for the next
product with the processor busy, for some hundredths of a second after each, and hold the cores that others need.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any, ParamSpec, TypeVar

import numba
from threadpoolctl import ThreadpoolController

Task = TypeVar("Task")
Result = TypeVar("Result")
Given = ParamSpec("Given")


def parallel_map(work: Callable[[Task], Result], tasks: Iterable[Task]) -> list[Result]:
    """The results in the order of the tasks; the work must not start compiled code that is parallel itself.

    Whoever asks works, too, beside helpers that wait from one call to the next. After an error no task is begun.
    """
    todo = list(tasks)
    results: list[Any] = [None] * len(todo)
    numbers = iter(range(len(todo)))  # shared: each thread takes the next one

    def work_on() -> None:
        try:
            for number in numbers:
                results[number] = work(todo[number])
        except BaseException:
            for _ in numbers:
                pass
            raise

    num_helpers = max(0, min(numba.get_num_threads(), len(todo)) - 1)
    helpers = [_helpers(os.getpid()).submit(work_on) for _ in range(num_helpers)]
    try:
        work_on()
    finally:
        begun = [helper for helper in helpers if not helper.cancel()]  # others may keep all helpers busy
        wait(begun)
    for helper in begun:
        helper.result()
    return results


@functools.cache
def _helpers(process: int) -> ThreadPoolExecutor:
    """Threads of this process; a fork of it needs its own."""
    return ThreadPoolExecutor(os.cpu_count())


def single_threaded_blas(work: Callable[Given, Result]) -> Callable[Given, Result]:
    """The same work, with linear algebra kept to one thread meanwhile (in the whole process)."""

    @functools.wraps(work)
    def alone(*given: Given.args, **named: Given.kwargs) -> Result:
        with _libraries().limit(limits=1, user_api="blas"):
            return work(*given, **named)

    return alone


@functools.cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()
