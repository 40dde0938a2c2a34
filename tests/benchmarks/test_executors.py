"""Wherever the work is done, every task gives its result once, and no task is taken before there is
room for it.
"""

import contextlib
import itertools
import os
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import pytest

from geovp_benchmarks.running import executors
from geovp_classic.errors import BadData

distributed = pytest.importorskip("distributed", reason="needs the extra: cluster")


def doubled(number: int) -> int:
    if number < 0:
        raise BadData(f"{number} is below zero")
    return 2 * number


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a cluster of one thread in this process."""
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, protocol="tcp"
    ) as cluster:
        yield cluster.scheduler_address


def test_dask_gives_every_result_once_and_holds_back(scheduler: str) -> None:
    tasks = deque(range(20))
    results = executors.completed(executors.Dask(scheduler), doubled, tasks)
    first = next(results)
    assert len(tasks) == 12  # 8 are waiting, the fewest with which a cluster can grow
    pairs = sum(results, first)
    assert sorted(pairs) == [(number, 2 * number) for number in range(20)]


def test_errors_of_a_task_come_back_as_they_were_after_what_had_begun(scheduler: str) -> None:
    for executor in (executors.Serial(), executors.Dask(scheduler)):
        results: list[object] = []
        batches = executors.completed(executor, doubled, deque([1, -1, *range(20)]))
        with pytest.raises(BadData, match="-1 is below zero"):
            results.extend(itertools.chain.from_iterable(batches))
        assert (1, 2) in results
        assert len(results) < 20


def environment(_: int) -> tuple[int, str, str]:
    time.sleep(0.5)  # so that each worker has a task
    return os.getpid(), os.environ["OMP_NUM_THREADS"], os.environ["CUDA_VISIBLE_DEVICES"]


@pytest.mark.parametrize("kind", ["processes", "dask"])
def test_workers_divide_cores_and_gpus(
    kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3,5")
    monkeypatch.setenv("TMPDIR", str(tmp_path))  # of the locks
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    executor: executors.Executor = executors.Processes(2)
    with contextlib.ExitStack() as stack:
        if kind == "dask":
            cluster = distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None)
            executor = executors.Dask(stack.enter_context(cluster).scheduler_address)
        batches = executors.completed(executor, environment, deque(range(8)))
        pairs = [*itertools.chain.from_iterable(batches)]
    of_process = {result[0]: result[1:] for _, result in pairs}
    assert len(of_process) == 2
    assert {threads for threads, _ in of_process.values()} == {
        "1" if kind == "dask" else str(max(1, (os.cpu_count() or 1) // 2))
    }
    assert sorted(gpu for _, gpu in of_process.values()) == ["3", "5"]
