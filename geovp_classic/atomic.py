"""Files and folders that appear only when they are complete, even if the writer is killed."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from geovp_classic.errors import BadData


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a scratch path that becomes the file or folder `path` at the end.

    The scratch is removed after an error. Parent folders are created; an existing file or empty
    folder is replaced, a pipe or device is refused.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise BadData(f"{path} is a pipe or device, which would be replaced: give another path")
    path.parent.mkdir(parents=True, exist_ok=True)
    scratch = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield scratch
        os.replace(scratch, path)
    except OSError as problem:
        if problem.filename == str(scratch):
            problem.filename = str(path)  # which messages name
        raise
    finally:
        if scratch.is_dir():
            shutil.rmtree(scratch, ignore_errors=True)
        else:
            scratch.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a whole file atomically."""
    with atomic_write(path) as scratch:
        scratch.write_bytes(content)
