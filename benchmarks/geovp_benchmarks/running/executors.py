"""Executors: compute tasks in this process, in other processes, or on a Dask cluster.

A task whose process dies, or that exceeds the time limit, comes back as `Lost`; the process is
replaced and the other tasks go on.
"""

import functools
import multiprocessing
import operator
import os
import queue
import signal
import statistics
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent import futures
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol, TypeVar

from filelock import FileLock, Timeout

from geovp_classic.errors import BadData

Task = TypeVar("Task")
Result = TypeVar("Result")
Prepare = Callable[[], object]  # loads code and builds components; the time limit excludes it


class Lost(Exception):
    """The reason why a task has no result: its process died or took too long."""


@dataclass(frozen=True)
class TimeLimit:
    """Seconds that a task may take: as given, or a multiple of the median of finished tasks.

    The first task of a process also compiles code, hence the minimum.
    """

    given_s: float | None = None
    median_ratio: float = 20.0
    min_s: float = 120.0
    first_s: float = 3600.0  # before any task has finished
    taken_s: list[float] = field(default_factory=list)  # of finished tasks

    def now_s(self) -> float:
        """Return the present limit."""
        if self.given_s is not None:
            return self.given_s
        if not self.taken_s:
            return self.first_s
        return max(self.min_s, self.median_ratio * statistics.median(self.taken_s))


class Pool(Protocol):
    """Place where tasks are computed."""

    def submit(self, function: Callable[[Any], Any], task: Any) -> futures.Future[Any]:
        """Begin a task; the error of its future is Lost if its process was."""

    def room(self) -> int:
        """Return the number of tasks that it should hold now."""


class Executor(Protocol):
    """Way to compute the tasks of a run."""

    def open(self, limit: TimeLimit, prepare: Prepare) -> AbstractContextManager[Pool]:
        """Return a pool whose processes are prepared once, and that ends tasks at the limit."""


@dataclass(frozen=True)
class Serial:
    """One task after the other, in this process, without a time limit."""

    @contextmanager
    def open(self, limit: TimeLimit, prepare: Prepare) -> Iterator[Pool]:
        """Yield the pool; raise BadData for a limit, which needs a process that can be ended."""
        if limit.given_s is not None:
            raise BadData("--workers 0 has no process to end at --time-limit: leave one out")
        yield self

    def submit(self, function: Callable[[Any], Any], task: Any) -> futures.Future[Any]:
        """Return the finished result."""
        future: futures.Future[Any] = futures.Future()
        try:
            future.set_result(function(task))
        except Exception as error:
            future.set_exception(error)
        return future

    def room(self) -> int:
        """Return 1."""
        return 1


@dataclass(frozen=True)
class Processes:
    """Several processes on this machine, which divide its cores and GPUs."""

    workers: int = 2

    @contextmanager
    def open(self, limit: TimeLimit, prepare: Prepare) -> Iterator[Pool]:
        """Yield the pool."""
        num_threads = max(1, (os.cpu_count() or 1) // self.workers)
        pool = WorkerPool([Worker(num_threads, limit, prepare) for _ in range(self.workers)])
        try:
            yield pool
        finally:  # files are renamed into place: none is left half written
            pool.close()


class Worker:
    """A process for one task at a time, which is replaced when it dies."""

    def __init__(self, num_threads: int, limit: TimeLimit, prepare: Prepare) -> None:
        self.num_threads = num_threads
        self.limit = limit
        self.prepare = prepare
        self.is_closed = False
        self._process: Any = None

    def compute(self, function: Callable[[Any], Any], task: Any) -> Any:
        """Return the result of a task; raise Lost if the process dies or exceeds the limit."""
        if self._process is None or not self._process.is_alive():
            self._start()
            self._ask(operator.call, self.prepare, lambda: self.limit.first_s)
        start_s = time.monotonic()
        result = self._ask(function, task, self.limit.now_s)
        self.limit.taken_s.append(time.monotonic() - start_s)
        return result

    def close(self) -> None:
        """End the process, also in the middle of a task."""
        self.is_closed = True
        if self._process is not None:
            self._process.kill()

    def _start(self) -> None:
        if self.is_closed:
            raise Lost("the run has ended")
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=work, args=(theirs, self.num_threads))
        self._process.start()
        theirs.close()  # so that the pipe ends with the process

    def _ask(self, function: Callable[[Any], Any], task: Any, limit_s: Callable[[], float]) -> Any:
        """Return what the process answers within the limit, which may change meanwhile."""
        start_s = time.monotonic()
        try:
            self._pipe.send((function, task))
            while not self._pipe.poll(0.2):
                if time.monotonic() - start_s > limit_s():
                    self._process.kill()
                    self._process.join()
                    raise Lost(f"it took longer than the time limit of {limit_s():.3g} s")
            result, error = self._pipe.recv()
        except (EOFError, OSError) as problem:
            self._process.join(10)
            code = self._process.exitcode or 0
            how = f"(exit code {code})"
            if code < 0:
                how = f"({signal.Signals(-code).name}); SIGKILL often means that memory ran out"
            raise Lost(f"its process died {how}") from problem
        if error is not None:
            raise error
        return result


class WorkerPool:
    """Pool of workers, each of which has a thread here that waits for it."""

    def __init__(self, workers: list[Worker]) -> None:
        self._workers = workers
        self._idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
        for worker in workers:
            self._idle.put(worker)
        self._threads = futures.ThreadPoolExecutor(len(workers))

    def submit(self, function: Callable[[Any], Any], task: Any) -> futures.Future[Any]:
        """Give a task to the next idle worker."""
        return self._threads.submit(self._compute, function, task)

    def room(self) -> int:
        """Return two tasks per worker, so that none waits for this process."""
        return 2 * len(self._workers)

    def close(self) -> None:
        """End all workers."""
        for worker in self._workers:
            worker.close()
        self._threads.shutdown(cancel_futures=True)

    def _compute(self, function: Callable[[Any], Any], task: Any) -> Any:
        worker = self._idle.get()
        try:
            return worker.compute(function, task)
        finally:
            self._idle.put(worker)


@dataclass(frozen=True)
class Dask:
    """A Dask cluster whose workers see this machine's file system under the same paths."""

    address: str
    timeout_s: float = 10.0  # for a scheduler to answer
    worker_timeout_s: float = 600.0  # for a first worker, which an adaptive cluster starts late

    @contextmanager
    def open(self, limit: TimeLimit, prepare: Prepare) -> Iterator[Pool]:
        """Yield the cluster; raise BadData if no scheduler or worker answers."""
        from dask.distributed import Client

        try:
            client = Client(self.address, timeout=self.timeout_s)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise self._unanswered("scheduler") from error
        with client:
            # also of workers that join later
            client.register_worker_callbacks(functools.partial(prepare_worker, os.getcwd()))
            try:
                client.submit(os.getpid, pure=False).result(timeout=self.worker_timeout_s)
            except OSError as error:
                raise self._unanswered("worker") from error
            yield DaskPool(client, limit, prepare)

    def _unanswered(self, what: str) -> BadData:
        return BadData(
            f"no Dask {what} answers at {self.address!r}: start a scheduler and workers, or give "
            "an address such as tcp://host:8786"
        )


class DaskPool:
    """Pool of the workers that a Dask cluster has at a time."""

    def __init__(self, client: Any, limit: TimeLimit, prepare: Prepare) -> None:
        self._client = client
        self._prepare = prepare
        self._limit = limit
        self._executor = client.get_executor(pure=False)

    def submit(self, function: Callable[[Any], Any], task: Any) -> futures.Future[Any]:
        """Give a task to the scheduler."""
        outer: futures.Future[Any] = futures.Future()
        inner = self._executor.submit(_limited, function, task, self._prepare, self._limit.now_s())

        def forward(done: futures.Future[Any]) -> None:
            if done.cancelled():
                outer.set_exception(Lost("the cluster gave it up"))
            elif (error := done.exception()) is None:
                result, taken_s = done.result()
                self._limit.taken_s.append(taken_s)
                outer.set_result(result)
            elif type(error).__name__ == "KilledWorker":
                outer.set_exception(Lost("its workers died or exceeded the time limit"))
            else:
                outer.set_exception(error)

        inner.add_done_callback(forward)
        return outer

    def room(self) -> int:
        """Return two tasks per thread now; at least 8, so that an adaptive cluster grows."""
        return max(8, 2 * sum(self._client.nthreads().values()))


def prepare_worker(folder: str, dask_worker: Any) -> None:
    """Prepare a worker of a cluster: relative paths, threads and GPU as on one machine."""
    with suppress(OSError):  # a folder of the driver alone
        os.chdir(folder)
    limit_libraries(dask_worker.state.nthreads)


def completed(
    executor: Executor,
    function: Callable[[Task], Result],
    tasks: deque[Task],
    limit: TimeLimit | None = None,
    interval_s: float = 2.0,
    prepare: Prepare = os.getpid,
) -> Iterator[list[tuple[Task, Result | Lost]]]:
    """Yield tasks with their results as they are ready; empty after `interval_s` without results.

    Tasks are taken from the left when the pool has room; more may be added meanwhile. The error of
    a task other than Lost is raised after the tasks that have begun.
    """
    waiting: dict[futures.Future[Result], Task] = {}
    failed: list[futures.Future[Result]] = []
    with executor.open(limit or TimeLimit(), prepare) as pool:
        while True:
            room = 0 if failed else pool.room() - len(waiting)
            for _ in range(min(room, len(tasks))):
                task = tasks.popleft()
                waiting[pool.submit(function, task)] = task
            if not waiting:
                break
            done, _ = futures.wait(waiting, interval_s, futures.FIRST_COMPLETED)
            ready: list[tuple[Task, Result | Lost]] = []
            for future in done:
                task, error = waiting.pop(future), future.exception()
                if error is None or isinstance(error, Lost):
                    ready.append((task, error or future.result()))
                else:
                    failed.append(future)
            yield ready
        for future in failed:
            future.result()  # raises its error


def work(pipe: Connection, num_threads: int) -> None:
    """Compute the tasks that come through a pipe, until it ends with the run."""
    limit_libraries(num_threads)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the run ends its workers itself
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError):
        while True:
            function, task = pipe.recv()
            result = failure = None
            try:
                result = function(task)
            except Exception as error:
                failure = error
            pipe.send((result, failure))


def limit_libraries(num_threads: int) -> None:
    """Limit the threads of libraries that are not loaded yet, and take a GPU of this machine."""
    for library in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
        os.environ.setdefault(f"{library}_NUM_THREADS", str(num_threads))
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", str(num_threads))
    lock = _gpu_lock()
    if lock is not None:
        os.environ["CUDA_VISIBLE_DEVICES"] = Path(lock.lock_file).stem.rpartition("-")[2]


@functools.cache
def _gpu_lock() -> FileLock | None:
    """Return the lock of a GPU that no other worker uses, which is kept as long as this process.

    None with fewer than two GPUs. Where all are used, workers share them evenly.
    """
    num_gpus = len([*Path("/proc/driver/nvidia/gpus").glob("*")])
    gpus = [str(number) for number in range(num_gpus)]
    if "CUDA_VISIBLE_DEVICES" in os.environ:
        gpus = os.environ["CUDA_VISIBLE_DEVICES"].split(",")
    if len(gpus) < 2:
        return None
    turn = 0
    while True:
        for gpu in gpus:
            lock = FileLock(Path(tempfile.gettempdir(), f"geovp-{turn}-gpu-{gpu}.lock"))
            with suppress(Timeout):
                lock.acquire(timeout=0)
                return lock
        turn += 1


def _limited(
    function: Callable[[Any], Any], task: Any, prepare: Prepare, limit_s: float
) -> tuple[Any, float]:  # result, seconds
    """Compute a task on a Dask worker, which ends, and is replaced by its nanny, at the limit."""
    prepare()
    timer = threading.Timer(limit_s, os._exit, (1,))
    timer.daemon = True
    start_s = time.monotonic()
    timer.start()
    try:
        return function(task), time.monotonic() - start_s
    finally:
        timer.cancel()


def _end_with_parent() -> None:
    """End this worker with the run, which cannot stop it if it is killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
