"""Lock of a results folder: one run at a time; scratch files of killed runs are removed."""

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from filelock import FileLock, Timeout

from geovp_benchmarks.results.store import Results
from geovp_classic.errors import BadData

logger = logging.getLogger(__name__)


@contextmanager
def results_lock(results: Results, protocol: Mapping[str, Any]) -> Iterator[None]:
    """Hold a results folder; the lock ends with the process.

    Waits for a run of the same protocol; raises BadData during a run of another protocol.
    """
    root = results.root
    root.mkdir(parents=True, exist_ok=True)
    lock = FileLock(root / ".lock")
    with suppress(NotImplementedError):  # a file system without locks
        try:
            lock.acquire(timeout=0)
        except Timeout as error:
            running = results.protocol() if results.begun else protocol
            if any(running[key] != protocol[key] for key in ("fingerprint", "methods", "clips")):
                raise BadData(
                    f"{root} is in use by a run with another protocol or other methods: wait until "
                    "it has ended, or give another folder with --out"
                ) from error
            logger.warning("waiting for another run in %s", root)
            lock.acquire()
    try:
        for scratch in [*root.glob("*/*/.*.part"), *root.glob("clips/.*.part")]:
            scratch.unlink(missing_ok=True)
        yield
    finally:
        lock.release()
