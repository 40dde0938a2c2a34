"""Where tasks are computed: in this process, in other processes of this machine, or on a Dask
cluster.

An executor maps a picklable function over tasks and yields results as they are ready. It takes the
next task only when it has room for it, so that the tasks' generator can use earlier results.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Protocol, TypeVar

from geovp_classic import registry
from geovp_classic.errors import BadData, GeovpError, MissingExtra

Task = TypeVar("Task")
Result = TypeVar("Result")
THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
CONNECT_TIMEOUT_S = 10.0  # for a scheduler to answer
TASKS_PER_WORKER = 2  # submitted at a time, so that no worker waits for the next one


class Executor(Protocol):
    """Computes the tasks of a run."""

    def map(self, function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """The results in any order; the function's own errors are raised."""
        ...


@dataclass(frozen=True)
class Serial:
    """One task after the other, in this process."""

    def map(self, function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """The results in the order of the tasks."""
        return map(function, tasks)


@dataclass(frozen=True)
class Processes:
    """Several processes on this machine, each with an equal share of its cores."""

    workers: int = 2

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise BadData(f"workers is {self.workers}, expected 1 or more")

    def map(self, function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Results as they are ready; GeovpError when a process dies."""
        threads = max(1, (os.cpu_count() or 1) // self.workers)
        pool = futures.ProcessPoolExecutor(
            self.workers, multiprocessing.get_context("spawn"), _begin_worker, (threads,)
        )
        try:
            yield from _results(pool, function, tasks, self.workers)
        except BrokenProcessPool as error:
            raise GeovpError(
                "a worker process died (out of memory?): run again, with fewer --workers"
            ) from error
        except (
            KeyboardInterrupt,
            GeneratorExit,
        ):  # parts are renamed into place: a worker may end at any moment
            for process in multiprocessing.active_children():
                process.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


@dataclass(frozen=True)
class Dask:
    """A Dask cluster whose workers see this machine's file system under the same paths."""

    address: str

    def map(self, function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Results as they are ready; MissingExtra without Dask, BadData when no scheduler
        answers.
        """
        try:
            import distributed
        except ModuleNotFoundError as error:
            raise MissingExtra(
                f"a Dask cluster needs dask: {registry.install_command('cluster')}"
            ) from error
        try:
            client = distributed.Client(self.address, timeout=CONNECT_TIMEOUT_S)
        except (OSError, ValueError) as error:
            raise BadData(
                f"no Dask scheduler answers at {self.address!r}: give one such as tcp://host:8786"
            ) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=CONNECT_TIMEOUT_S / 2)
            except TimeoutError as error:
                raise BadData(
                    f"the Dask cluster at {self.address} has no worker: start one (dask worker)"
                ) from error
            workers = max(1, sum(client.nthreads().values()))
            yield from _results(client.get_executor(pure=False), function, tasks, workers)


def _results(
    pool: futures.Executor, function: Callable[[Task], Result], tasks: Iterable[Task], workers: int
) -> Iterator[Result]:
    """Results as they are ready; a task is taken only when the pool has room for it."""
    waiting: set[futures.Future[Result]] = set()
    for task in tasks:
        waiting.add(pool.submit(function, task))
        if len(waiting) >= TASKS_PER_WORKER * workers:
            done, waiting = futures.wait(waiting, return_when=futures.FIRST_COMPLETED)
            yield from (future.result() for future in done)
    yield from (future.result() for future in futures.as_completed(waiting))


def _begin_worker(threads: int) -> None:
    """Limit the threads of libraries that a worker imports later, and end the worker when the run
    ends.
    """
    for variable in THREAD_LIMITS:
        os.environ.setdefault(variable, str(threads))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the run ends its workers itself
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A killed run cannot stop its workers: without this they would wait for it and keep their
    memory.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
