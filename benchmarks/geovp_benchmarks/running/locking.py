"""One protocol at a time fills a results folder; scratch files of killed processes are removed.

A run holds a lock file named after its protocol for as long as it lasts. Runs of the same protocol
may fill a folder together. A lock ends with its process, however that ends.
"""

import contextlib
import os
import re
import shutil
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from geovp_benchmarks.results.provenance import content_hash
from geovp_classic.errors import BadData

_SCRATCH = re.compile(r"\..+\.(\d+)\.part")  # as `atomic_write` calls them
Claim = Callable[[str], None]


def unclaimed(protocol: str) -> None:
    """Claim a folder in which nothing is written, or that nobody else fills."""


@contextlib.contextmanager
def results_lock(root: Path) -> Iterator[Claim]:
    """Yield a function that claims a results folder for a protocol.

    The claim raises BadData while a run of another protocol fills the folder.
    """
    with contextlib.ExitStack() as held:
        yield lambda protocol: _claim(root, protocol, held)


def _claim(root: Path, protocol: str, held: contextlib.ExitStack) -> None:
    owner = f"process {os.getpid()} on {socket.gethostname()}"
    key = content_hash(protocol)[:16]
    own = root / f".run-{key} {owner}.lock"
    try:
        root.mkdir(parents=True, exist_ok=True)
        with FileLock(root / ".lock"):
            others = [path for path in root.glob(".run-*.lock") if path != own and _is_held(path)]
            for path in others:
                held_protocol, _, other = path.stem.removeprefix(".run-").partition(" ")
                if held_protocol != key:
                    raise BadData(
                        f"{root} is in use by {other} with another protocol or other methods: "
                        "wait until it has ended, or give another folder with --out"
                    )
            if not others:
                sweep(root)
            held.callback(own.unlink, missing_ok=True)
            with contextlib.suppress(Timeout):  # this process holds it already
                held.enter_context(FileLock(own, timeout=0))
    except NotImplementedError:  # a file system without locks
        return
    except OSError as error:
        raise BadData(
            f"{root} cannot be a results folder ({error.strerror}): give a folder that can be "
            "written with --out"
        ) from error


def _is_held(path: Path) -> bool:
    """Return whether a process holds a lock file; remove the file if none does."""
    try:
        with FileLock(path, timeout=0):
            path.unlink(missing_ok=True)
    except Timeout:
        return True
    return False


def sweep(root: Path) -> None:
    """Remove scratch files and folders, for when no run is writing; those of processes that live
    here are left.
    """
    for path in root.rglob(".*.part"):
        found = _SCRATCH.fullmatch(path.name)
        if found is None or _lives(int(found[1])):
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return process != os.getpid()
