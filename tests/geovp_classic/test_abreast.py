"""Side by side means: same results, same order, the same errors."""

import threading

import numba
import pytest

from geovp_classic.abreast import abreast


def test_results_keep_the_order_of_the_tasks() -> None:
    assert abreast(lambda n: n * n, range(50)) == [n * n for n in range(50)]
    assert abreast(str, []) == []


def test_as_many_work_at_once_as_there_are_threads() -> None:
    count = numba.get_num_threads()
    meeting = threading.Barrier(count, timeout=10)  # breaks unless all are there at the same time
    assert len(abreast(lambda _: meeting.wait(), range(count))) == count


def test_an_error_comes_out() -> None:
    with pytest.raises(ZeroDivisionError):
        abreast(lambda n: 1 // n, [1, 0])
