"""Locks of results folders: one protocol at a time; scratch files of killed processes are removed.

A run holds a lock file named after its protocol for as long as it lasts. Runs of the same protocol
may fill a folder together. A lock ends with its process, however that ends.
"""

import os
import re
import shutil
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from geovp_benchmarks.results.provenance import content_hash
from geovp_classic.errors import BadData


@contextmanager
def results_lock(root: Path, protocol: str) -> Iterator[None]:
    """Hold a results folder for a protocol; raise BadData while another protocol's run does."""
    with ExitStack() as stack:
        try:
            root.mkdir(parents=True, exist_ok=True)
            with FileLock(root / ".lock"):
                _lock(root, content_hash(protocol)[:16], stack)
        except NotImplementedError:  # a file system without locks
            pass
        except OSError as error:
            raise BadData(
                f"{root} cannot be a results folder ({error.strerror}): give a folder that can be "
                "written with --out"
            ) from error
        yield


def _lock(root: Path, key: str, stack: ExitStack) -> None:
    """Take the lock of this process, unless a run of another protocol holds one."""
    lock = root / f".run-{key} process {os.getpid()} on {socket.gethostname()}.lock"
    others = [path for path in root.glob(".run-*.lock") if path != lock and _is_held(path)]
    for path in others:
        other_key, _, owner = path.stem.removeprefix(".run-").partition(" ")
        if other_key != key:
            raise BadData(
                f"{root} is in use by {owner} with another protocol or other methods: wait until "
                "it has ended, or give another folder with --out"
            )
    if not others:
        remove_scratch(root)
    stack.callback(lock.unlink, missing_ok=True)
    with suppress(Timeout):  # this process holds it already
        stack.enter_context(FileLock(lock, timeout=0))


def _is_held(path: Path) -> bool:
    """Return whether a process holds a lock file; remove the file if none does."""
    try:
        with FileLock(path, timeout=0):
            path.unlink(missing_ok=True)
    except Timeout:
        return True
    return False


def remove_scratch(root: Path) -> None:
    """Remove the scratch files and folders of `atomic_write` whose processes have ended."""
    for path in root.rglob(".*.part"):
        process = re.fullmatch(r"\..+\.(\d{1,9})\.part", path.name)
        if process is None or _is_alive(int(process[1])):
            continue
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _is_alive(process: int) -> bool:
    """Return whether a process of this machine is alive."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return process != os.getpid()
