"""Where chunks of work are done: here, in other processes of this machine, or on a Dask cluster.

An executor maps a picklable function over tasks and yields the results as they come. It takes the next task only when
it has room for it, so that whoever makes the tasks may look at earlier results first.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Protocol, TypeVar

from geovp_classic.errors import BadData, GeovpError, MissingExtra

Task = TypeVar("Task")
Result = TypeVar("Result")
THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
PATIENCE_S = 10.0  # until somebody answers at an address
AHEAD = 2  # tasks a worker, so that none waits for the next one


class Executor(Protocol):
    """Does the tasks of a run."""

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
        """Raise BadData unless there is at least one worker."""
        if self.workers < 1:
            raise BadData(f"workers is {self.workers}, expected 1 or more")

    def map(self, function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """The results as they come; GeovpError when a process dies."""
        threads = max(1, (os.cpu_count() or 1) // self.workers)
        pool = futures.ProcessPoolExecutor(
            self.workers, multiprocessing.get_context("spawn"), _begin_worker, (threads,)
        )
        try:
            yield from _results(pool, function, tasks, self.workers)
        except BrokenProcessPool as error:
            raise GeovpError("a worker process died (out of memory?): run again, with fewer --workers") from error
        finally:
            pool.shutdown(cancel_futures=True)


@dataclass(frozen=True)
class Dask:
    """A Dask cluster whose workers see this machine's file system under the same paths."""

    address: str

    def map(self, function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """The results as they come; MissingExtra without Dask, BadData when nobody answers at the address."""
        try:
            import distributed
        except ModuleNotFoundError as error:
            raise MissingExtra("a Dask cluster needs dask: pip install 'geovp-classic[cluster]'") from error
        try:
            client = distributed.Client(self.address, timeout=PATIENCE_S)
        except (OSError, ValueError) as error:
            raise BadData(f"no Dask scheduler answers at {self.address!r}: give one such as tcp://host:8786") from error
        with client, client.get_executor(pure=False) as pool:
            yield from _results(pool, function, tasks, max(1, sum(client.nthreads().values())))


def _results(
    pool: futures.Executor, function: Callable[[Task], Result], tasks: Iterable[Task], workers: int
) -> Iterator[Result]:
    """The results as they come; a task is taken only when the pool has room for it."""
    waiting: set[futures.Future[Result]] = set()
    for task in tasks:
        waiting.add(pool.submit(function, task))
        if len(waiting) >= AHEAD * workers:
            done, waiting = futures.wait(waiting, return_when=futures.FIRST_COMPLETED)
            yield from (future.result() for future in done)
    yield from (future.result() for future in futures.as_completed(waiting))


def _begin_worker(threads: int) -> None:
    """Keep a worker's libraries, imported later, from a thread a core each, and the worker from outliving the run."""
    for variable in THREAD_LIMITS:
        os.environ.setdefault(variable, str(threads))
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A killed run cannot tell its workers, and they would wait for it for ever, with all their memory."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
