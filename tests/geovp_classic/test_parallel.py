"""A parallel map gives the same results in the same order, and the same errors, as a loop."""

import os
import threading

import numba
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from geovp_classic.parallel import parallel_map, single_threaded_blas


def test_results_keep_the_order_of_the_tasks() -> None:
    assert parallel_map(lambda n: n * n, range(50)) == [n * n for n in range(50)]
    assert parallel_map(str, []) == []


def test_as_many_work_at_once_as_there_are_threads() -> None:
    count = numba.get_num_threads()
    meeting = threading.Barrier(count, timeout=10)  # breaks unless all are there at the same time
    assert len(parallel_map(lambda _: meeting.wait(), range(count))) == count


def test_an_error_comes_out() -> None:
    with pytest.raises(ZeroDivisionError):
        parallel_map(lambda n: 1 // n, [1, 0])


def test_no_task_begins_after_an_error() -> None:
    begun = []

    def work(n: int) -> None:
        begun.append(n)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        parallel_map(work, range(100))
    assert len(begun) <= numba.get_num_threads()


def test_calls_may_be_nested() -> None:
    # Pool threads that wait for pool threads would wait for ever.
    assert parallel_map(lambda n: sum(parallel_map(lambda m: n * m, range(5))), range(8)) == [
        10 * n for n in range(8)
    ]


def test_a_fork_has_threads_of_its_own() -> None:
    count = numba.get_num_threads()
    parallel_map(str, range(count))  # starts the threads
    child = os.fork()
    if child == 0:
        try:
            meeting = threading.Barrier(count, timeout=10)
            parallel_map(lambda _: meeting.wait(), range(count))
            os._exit(0)
        finally:
            os._exit(1)
    assert os.waitpid(child, 0)[1] == 0


def blas_threads() -> set[int]:
    return {
        library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"
    }


def test_linear_algebra_has_one_thread_meanwhile_and_all_its_threads_afterwards() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        assert blas_threads() == {2}
        assert single_threaded_blas(
            lambda: (blas_threads(), single_threaded_blas(blas_threads)())
        )() == ({1}, {1})
        assert blas_threads() == {2}


def test_it_has_them_after_an_error_too() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        with pytest.raises(ZeroDivisionError):
            single_threaded_blas(lambda: 1 // 0)()
        assert blas_threads() == {2}


def test_work_keeps_its_name_and_its_arguments() -> None:
    def halved(number: int, by: int = 2) -> int:
        return number // by

    assert single_threaded_blas(halved)(9, by=3) == 3
    assert single_threaded_blas(halved).__name__ == "halved"
