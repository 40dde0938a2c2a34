"""One protocol at a time fills a results folder, and what killed processes left half written in it
is removed.

The file `.lock` is locked in two places: byte 0 for as long as somebody looks who else is there,
byte 1, shared, for as long as a run lasts. A lock ends with its process, however that ends.
"""

import contextlib
import fcntl
import os
import re
import shutil
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

from geovp_classic.errors import BadData, GeovpError

LOCK = ".lock"
GUARD, RUN = 0, 1  # bytes of it
_SCRATCH = re.compile(r"\..+\.(\d+)\.part")  # as `atomic_write` calls them
Claim = Callable[[str], None]


def unclaimed(protocol: str) -> None:
    """A claim of a folder in which nothing is written, or that nobody else fills."""


@contextlib.contextmanager
def results_lock(root: Path) -> Iterator[Claim]:
    """A function that claims a results folder for a protocol; BadData when a run of another one is
    filling it.
    """
    is_new = not root.exists()
    try:
        root.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(
            root / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666
        )
    except OSError as error:
        raise BadData(
            f"{root} cannot be a results folder ({error.strerror}): give a folder that can be "
            "written with --out"
        ) from error
    with open(descriptor, "r+", encoding="utf-8") as file:
        try:
            yield lambda protocol: _claim(root, file.fileno(), protocol)
        except GeovpError:
            if (
                is_new and os.listdir(root) == [LOCK] and not os.fstat(file.fileno()).st_size
            ):  # nobody claimed it
                os.unlink(root / LOCK)
                os.rmdir(root)
            raise


def _claim(root: Path, descriptor: int, protocol: str) -> None:
    with contextlib.suppress(OSError):  # a file system without locks
        fcntl.lockf(descriptor, fcntl.LOCK_EX, 1, GUARD)
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, RUN)
    except (BlockingIOError, PermissionError):
        found, _, owner = os.pread(descriptor, 4096, 0).decode(errors="replace").partition("\n")
        if found != protocol:
            raise BadData(
                f"{root} is in use by {owner.strip() or 'another run'} with another "
                "protocol or other methods: wait until it has ended, or give another folder with "
                "--out"
            ) from None
    except OSError:
        return
    else:  # nobody else is here
        os.ftruncate(descriptor, 0)
        os.pwrite(
            descriptor, f"{protocol}\nprocess {os.getpid()} on {socket.gethostname()}\n".encode(), 0
        )
        sweep(root)
    fcntl.lockf(descriptor, fcntl.LOCK_SH, 1, RUN)
    fcntl.lockf(descriptor, fcntl.LOCK_UN, 1, GUARD)


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
