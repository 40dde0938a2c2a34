"""A parallel map gives the results and errors of a loop, and BLAS threads can be limited."""

import multiprocessing
import threading

import numba
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from geovp_classic.parallel import parallel_map, single_threaded_blas


def meet() -> int:
    """Wait for as many threads as there are; return their number."""
    count = numba.config.NUMBA_NUM_THREADS
    meeting = threading.Barrier(count, timeout=10)
    return len(parallel_map(lambda _: meeting.wait(), range(count)))


def test_all_threads_work_at_once_also_in_a_fork() -> None:
    assert meet() == numba.config.NUMBA_NUM_THREADS
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply(meet) == numba.config.NUMBA_NUM_THREADS


def test_an_error_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        parallel_map(lambda n: 1 // n, [1, 0])


def test_calls_may_be_nested() -> None:
    """Threads of the pool must not wait for other threads of the pool; results keep their order."""
    rows = parallel_map(lambda n: sum(parallel_map(lambda m: n * m, range(5))), range(50))
    assert rows == [10 * n for n in range(50)]


def blas_threads() -> set[int]:
    libraries = threadpool_info()
    return {library["num_threads"] for library in libraries if library["user_api"] == "blas"}


def test_blas_has_one_thread_while_a_function_runs() -> None:
    @single_threaded_blas
    def nested(divisor: int) -> set[int]:
        return single_threaded_blas(blas_threads)() | blas_threads() | {4 // divisor}

    with threadpool_limits(limits=2, user_api="blas"):
        assert nested(divisor=4) == {1}
        with pytest.raises(ZeroDivisionError):
            nested(0)
        assert blas_threads() == {2}
    assert nested.__name__ == "nested"


def set_blas_threads(count: int) -> None:
    """Set it in a thread of its own, since only the end of a thread frees the setting again."""
    setting = {"limits": count, "user_api": "blas"}
    thread = threading.Thread(target=threadpool_limits, kwargs=setting)
    thread.start()
    thread.join()


def test_overlapping_calls_give_the_threads_back() -> None:
    """The second call begins while the first one runs, and ends after it."""
    first_runs, second_runs, first_ended = (threading.Event() for _ in range(3))

    @single_threaded_blas
    def first() -> None:
        first_runs.set()
        second_runs.wait(10)

    @single_threaded_blas
    def second() -> None:
        second_runs.set()
        first_ended.wait(10)

    threads = [threading.Thread(target=work) for work in (first, second)]
    before = max(blas_threads())
    set_blas_threads(2)
    threads[0].start()
    assert first_runs.wait(10)
    threads[1].start()
    threads[0].join()
    first_ended.set()
    threads[1].join()
    after = blas_threads()
    set_blas_threads(before)
    assert after == {2}
