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
TASKS_PER_WORKER = 2  # submitted at a time, so that no worker waits for the next task


class Executor(Protocol):
    """Way to compute the tasks of a run."""

    def map(self, function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Yield the results in any order; errors of the function are raised."""


@dataclass(frozen=True)
class Serial:
    """One task after the other, in this process."""

    def map(self, function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Yield the results in the order of the tasks."""
        return map(function, tasks)


@dataclass(frozen=True)
class Processes:
    """Several processes on this machine, which divide its cores."""

    workers: int = 2

    def map(self, function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Yield results as they are ready; raise GeovpError if a process dies."""
        num_threads = max(1, (os.cpu_count() or 1) // self.workers)
        pool = futures.ProcessPoolExecutor(
            self.workers, multiprocessing.get_context("spawn"), _begin_worker, (num_threads,)
        )
        try:
            yield from _results(pool, function, tasks, self.workers)
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

    def map(self, function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
        """Yield results as they are ready; raise BadData if no scheduler or worker answers."""
        try:
            import distributed
        except ModuleNotFoundError as error:
            raise MissingExtra(
                f"a Dask cluster needs dask: {registry.install_command('cluster')}"
            ) from error
        try:
            client = distributed.Client(self.address, timeout=self.timeout_s)
            client.wait_for_workers(1, timeout=self.timeout_s)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise BadData(
                f"no Dask scheduler with a worker answers at {self.address!r}: start them, or give "
                "an address such as tcp://host:8786"
            ) from error
        with client:
            num_threads = sum(client.nthreads().values())
            yield from _results(client.get_executor(pure=False), function, tasks, num_threads)


def _results(
    pool: futures.Executor, function: Callable[[Task], Result], tasks: Iterable[Task], workers: int
) -> Iterator[Result]:
    """Yield results as they are ready; take a task only when the pool has room for it."""
    waiting: set[futures.Future[Result]] = set()
    for task in tasks:
        waiting.add(pool.submit(function, task))
        if len(waiting) >= TASKS_PER_WORKER * workers:
            done, waiting = futures.wait(waiting, return_when=futures.FIRST_COMPLETED)
            yield from (future.result() for future in done)
    yield from (future.result() for future in futures.as_completed(waiting))


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
