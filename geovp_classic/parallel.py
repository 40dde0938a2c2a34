"""Work on several images at once in threads, since OpenCV and NumPy release the GIL.

BLAS gains nothing from more threads on small matrices: OpenBLAS's threads wait busily for the next
product, and hold the cores that other threads need.
"""

import functools
import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar

import numba
from threadpoolctl import ThreadpoolController

Task = TypeVar("Task")
Result = TypeVar("Result")
Parameters = ParamSpec("Parameters")


def parallel_map(work: Callable[[Task], Result], tasks: Iterable[Task]) -> list[Result]:
    """Return the results in the order of the tasks, from as many threads as NUMBA_NUM_THREADS says.

    Nested calls work in the calling thread.
    """
    todo = list(tasks)
    is_nested = threading.current_thread().name.startswith("geovp")
    if is_nested or len(todo) < 2:
        return [work(task) for task in todo]
    num_threads = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    return list(_pool(os.getpid(), num_threads).map(work, todo))


@functools.cache
def _pool(process: int, num_threads: int) -> ThreadPoolExecutor:
    """Return the threads of this process; a fork needs other ones."""
    return ThreadPoolExecutor(num_threads, thread_name_prefix="geovp")


def single_threaded_blas(
    work: Callable[Parameters, Result],
) -> Callable[Parameters, Result]:
    """Limit BLAS to one thread in the whole process while the function runs.

    Of nested or overlapping calls, the first sets the limit and lifts it when it ends. One in
    another thread that lasts longer continues with more threads. It could not lift the limit
    itself: threadpoolctl ignores all threads but the one that set it, while that one lives.
    """

    @functools.wraps(work)
    def limited(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        if not _is_limited.acquire(blocking=False):
            return work(*args, **kwargs)
        try:
            with _libraries().limit(limits=1, user_api="blas"):
                return work(*args, **kwargs)
        finally:
            _is_limited.release()

    return limited


_is_limited = threading.Lock()  # held by the call that set the limit
_libraries = functools.cache(ThreadpoolController)  # looking for them takes milliseconds
