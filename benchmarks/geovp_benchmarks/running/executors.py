"""Executors: compute tasks in this process, in other processes, or on a Dask cluster."""

import itertools
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from geovp_classic.errors import BadData, GeovpError

Task = TypeVar("Task")
Result = TypeVar("Result")
Pool = tuple[futures.Executor, int]  # and the number of tasks that it is given at a time


class Executor(Protocol):
    """Way to compute the tasks of a run."""

    def open(self) -> AbstractContextManager[Pool]:
        """Return a pool, and the number of tasks that it is given at a time."""


class ThisProcess(futures.Executor):
    """Pool that computes a task when it is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> futures.Future[Any]:
        """Return the finished result; errors are raised here."""
        future: futures.Future[Any] = futures.Future()
        future.set_result(fn(*args, **kwargs))
        return future


@dataclass(frozen=True)
class Serial:
    """One task after the other, in this process."""

    @contextmanager
    def open(self) -> Iterator[Pool]:
        """Yield the pool."""
        yield ThisProcess(), 1


@dataclass(frozen=True)
class Processes:
    """Several processes on this machine, which divide its cores."""

    workers: int = 2

    @contextmanager
    def open(self) -> Iterator[Pool]:
        """Yield the pool; raise GeovpError if a process dies."""
        num_threads = max(1, (os.cpu_count() or 1) // self.workers)
        context = multiprocessing.get_context("spawn")
        pool = futures.ProcessPoolExecutor(self.workers, context, _begin_worker, (num_threads,))
        try:
            yield pool, 2 * self.workers
        except BrokenProcessPool as error:
            raise GeovpError(
                "a worker process died (out of memory?): run again, with fewer --workers"
            ) from error
        except (KeyboardInterrupt, GeneratorExit):
            for process in multiprocessing.active_children():
                process.terminate()  # files are renamed into place: none is left half written
            raise
        finally:
            pool.shutdown(cancel_futures=True)


@dataclass(frozen=True)
class Dask:
    """A Dask cluster whose workers see this machine's file system under the same paths."""

    address: str
    timeout_s: float = 10.0  # for a scheduler and a worker to answer

    @contextmanager
    def open(self) -> Iterator[Pool]:
        """Yield the cluster; raise BadData if no scheduler or worker answers."""
        from dask.distributed import Client

        try:
            client = Client(self.address, timeout=self.timeout_s)
            client.wait_for_workers(1, timeout=self.timeout_s)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise BadData(
                f"no Dask scheduler with a worker answers at {self.address!r}: start them, or give "
                "an address such as tcp://host:8786"
            ) from error
        with client:
            yield client.get_executor(pure=False), 2 * sum(client.nthreads().values())


def completed(
    executor: Executor,
    function: Callable[[Task], Result],
    tasks: Iterable[Task],
    interval_s: float = 2.0,
) -> Iterator[list[Result]]:
    """Yield lists of results as they are ready; empty after `interval_s` without results.

    Tasks are taken from the iterable when the pool has room for them. The error of a task is raised
    after the tasks that have begun.
    """
    remaining = iter(tasks)
    waiting: set[futures.Future[Result]] = set()
    failed: list[futures.Future[Result]] = []
    with executor.open() as (pool, room):
        while True:
            for task in itertools.islice(remaining, 0 if failed else room - len(waiting)):
                waiting.add(pool.submit(function, task))
            if not waiting:
                break
            done, waiting = futures.wait(waiting, interval_s, futures.FIRST_COMPLETED)
            failed += [future for future in done if future.exception()]
            yield [future.result() for future in done.difference(failed)]
        for future in failed:
            future.result()  # raises its error


def _begin_worker(num_threads: int) -> None:
    """Limit the threads of libraries, and end the worker when the run ends."""
    for library in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
        os.environ.setdefault(f"{library}_NUM_THREADS", str(num_threads))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the run ends its workers itself
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker with the run, which cannot stop it if it is killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
