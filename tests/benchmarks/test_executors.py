"""Wherever the work is done, every task gives its result once, and no task is taken before there is
room for it.
"""

import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest

from geovp_benchmarks.running import executors
from geovp_classic import registry
from geovp_classic.errors import BadData
from tests.benchmarks.made import STILL, content, go, rows

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


@pytest.mark.parametrize(
    ("spec", "kind"),
    [
        ({"name": "serial"}, executors.Serial),
        ({"name": "processes", "workers": 3}, executors.Processes),
        ({"name": "dask", "address": "tcp://host:8786"}, executors.Dask),
    ],
)
def test_executors_are_found_by_name(spec: dict[str, object], kind: type) -> None:
    assert isinstance(registry.build("executors", spec), kind)


def test_dask_gives_every_result_once_and_holds_back(scheduler: str) -> None:
    taken: list[int] = []

    def tasks() -> Iterator[int]:
        for number in range(20):
            taken.append(number)
            yield number

    results = executors.completed(executors.Dask(scheduler), doubled, tasks())
    first = next(results)
    assert len(taken) <= 3
    assert sorted(sum(results, first)) == [2 * number for number in range(20)]


def test_errors_of_a_task_come_back_as_they_were_after_what_had_begun(scheduler: str) -> None:
    for executor in (executors.Serial(), executors.Dask(scheduler)):
        results: list[int] = []
        batches = executors.completed(executor, doubled, [1, -1, *range(20)])
        with pytest.raises(BadData, match="-1 is below zero"):
            results.extend(itertools.chain.from_iterable(batches))
        assert 2 in results
        assert len(results) < 20


def test_a_matrix_on_a_cluster_gives_the_rows_of_one_process(
    scheduler: str, tmp_path: Path, toys: Path
) -> None:
    tables = content(predictors={"noise": {"name": "toy-noise", "num_samples": 2}, **STILL})
    found = []
    for name, executor in (("one", executors.Serial()), ("many", executors.Dask(scheduler))):
        methods = go(tmp_path / name, tables, executor)
        found.append([row for method in methods for row in rows(tmp_path / name, method)])
    assert found[0] == found[1]
    assert len(found[0]) == 5 * 2 * (2 + 1)
