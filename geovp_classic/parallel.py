"""Work on several images at once, in threads: OpenCV and numpy release the GIL, so each core takes
an image.

BLAS gains nothing from more threads on small matrices: OpenBLAS's threads wait busily for the next
product, for some hundredths of a second, and hold the cores that other threads need.
"""

import functools
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any, ParamSpec, TypeVar

import numba
from threadpoolctl import ThreadpoolController

# For numba's `fastmath`: loops become vectors without changing a result. What it leaves out (sums
# in another order,
# fused and approximate operations) gives other bits on other processors.
SAME_BITS = {"nnan", "ninf", "nsz"}

Task = TypeVar("Task")
Result = TypeVar("Result")
Parameters = ParamSpec("Parameters")


def parallel_map(work: Callable[[Task], Result], tasks: Iterable[Task]) -> list[Result]:
    """The results in the order of the tasks.

    The calling thread works beside those of a pool, so that nested calls cannot deadlock. After an
    error no further task is started.
    """
    todo = list(tasks)
    results: list[Any] = [None] * len(todo)
    numbers = iter(range(len(todo)))  # shared: each thread takes the next one

    def work_on() -> None:
        try:
            for number in numbers:
                results[number] = work(todo[number])
        except BaseException:
            list(numbers)  # leaves none for the other threads
            raise

    num_others = max(0, min(numba.get_num_threads(), len(todo)) - 1)
    others = [_pool(os.getpid()).submit(work_on) for _ in range(num_others)]
    try:
        work_on()
    finally:
        started = [
            other for other in others if not other.cancel()
        ]  # the pool may be busy with other calls
        wait(started)
    for other in started:
        other.result()
    return results


@functools.cache
def _pool(process: int) -> ThreadPoolExecutor:
    """The threads of this process; a fork of it needs its own."""
    return ThreadPoolExecutor(os.cpu_count())


def single_threaded_blas(work: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """The same function with BLAS limited to one thread while it runs (in the whole process)."""

    @functools.wraps(work)
    def limited(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        with _libraries().limit(limits=1, user_api="blas"):
            return work(*args, **kwargs)

    return limited


_libraries = functools.cache(ThreadpoolController)
