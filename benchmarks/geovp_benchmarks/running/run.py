"""Run of a matrix: compute what is missing in its results folder, however earlier runs ended."""

import logging
import time
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent import futures
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from filelock import FileLock, Timeout

from geovp.progress import announce, report
from geovp_benchmarks.failure import Failure
from geovp_benchmarks.results.store import Method
from geovp_benchmarks.running.executors import Executor, Lost, TimeLimit, completed
from geovp_benchmarks.running.plan import Plan
from geovp_benchmarks.running.task import Scored, attempts, load, score_clip, unscored

logger = logging.getLogger(__name__)


@contextmanager
def results_lock(root: Path, abandoned_s: float = 3600.0) -> Iterator[None]:
    """Hold a results folder while shared records are written; the lock ends with the process.

    Score files need no lock: each process writes its own.
    """
    root.mkdir(parents=True, exist_ok=True)
    lock = FileLock(root / ".lock")
    with suppress(NotImplementedError):  # a file system without locks
        try:
            lock.acquire(timeout=1)  # others hold it for moments
        except Timeout:
            logger.warning("waiting for another run in %s", root)
            lock.acquire()
    try:
        for scratch in [*root.glob("*/*/.*.part"), *root.glob("clips/.*.part")]:
            with suppress(FileNotFoundError):
                if time.time() - scratch.stat().st_mtime > abandoned_s:  # others are in use
                    scratch.unlink()
        yield
    finally:
        lock.release()


def run(plan: Plan, executor: Executor, limit: TimeLimit | None = None) -> list[Method]:
    """Compute missing and outdated scores, and return all methods.

    Scores are written every two seconds and at the end. A clip that ends its process or exceeds the
    time limit is recorded as failed. Raises BadData if the matrix, the data set or the folder is
    unsuitable.
    """
    # DuckDB would turn an interrupt of the main thread into an error of its own
    with futures.ThreadPoolExecutor(1) as writer:
        announce("building components and metrics")
        with results_lock(plan.results.root):
            begin(plan)
        tasks = deque(plan.tasks())
        num_missing = sum(len(task.methods) for task in tasks)
        num_done = 0
        report(num_done, num_missing)
        announce("first prediction: reading a clip, loading or compiling code")
        batch: list[Scored] = []
        written_s = 0.0
        try:
            prepare = partial(load, plan.matrix_json)
            for results in completed(executor, score_clip, tasks, limit, prepare=prepare):
                for task, outcome in results:
                    if isinstance(outcome, Lost):
                        logger.warning("clip %s: %s", task.clip, outcome)
                        again = attempts(task, str(outcome))
                        tasks.extendleft(again)
                        if again:
                            continue
                        outcome = unscored(task, Failure("failed", str(outcome)))
                    batch += outcome
                    num_done += len(outcome)
                    announce(f"after {task.clip}")  # other processes do not announce their steps
                    logger.info("clip %s: done", task.clip)
                report(num_done, num_missing)
                if time.monotonic() - written_s >= 2.0:
                    writer.submit(plan.results.write_scores, batch).result()
                    batch = []
                    written_s = time.monotonic()
        finally:
            writer.submit(finish, plan, batch).result()
    return plan.results.methods()


def begin(plan: Plan) -> None:
    """Write the records of the protocol and of all methods.

    Damaged files are set aside.
    """
    results = plan.results
    if changed := plan.changed:
        logger.warning(
            "%d clips changed since they were scored, such as %s: they are computed again",
            len(changed),
            changed[0],
        )
    results.write_protocol(plan.protocol)
    stored = results.by_name()
    for method in plan.methods:
        before = stored.get(method.name)
        is_same = before and before.num_clips and before.asked == method.asked
        if method.fingerprint or not is_same:  # else another machine could build and run it
            results.write_method(method)
    for path in results.damaged_files():
        aside = path.rename(path.with_name(f"{path.name}.damaged"))
        logger.warning("%s was damaged: it is set aside as %s and computed again", path, aside.name)


def finish(plan: Plan, batch: Sequence[Scored]) -> None:
    """Write the last scores, merge the score files of each method, and write its failures."""
    results = plan.results
    results.write_scores(batch)
    methods = [method for method in plan.methods if method.fingerprint]
    with results_lock(results.root):
        results.merge(methods)
        stored = results.by_name()
        for method in methods:
            scored = stored[method.name].scored
            failures = [*scored.failures.values()]
            if failures:
                first = failures[0]
                logger.info("%s: %s\n%s", method.label, first.reason, first.traceback.rstrip())
                outcome = {"traceback": first.traceback}
                if len(failures) == len(scored):  # nothing was predicted
                    outcome = first._asdict()
                    results.discard(stored[method.name])  # so that the next run tries again
                results.write_method(method.model_copy(update=outcome))
