"""A folder for the compiled kernels of numba where numba itself finds no writable one."""

import os
from pathlib import Path


def choose_folder(package: Path = Path(__file__).parent) -> None:
    """Set NUMBA_CACHE_DIR to a temporary folder unless numba finds a folder by itself.

    It tries a given folder, the package, then the user's cache, and raises RuntimeError if it can
    write to none of them.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folders = [package / "__pycache__", Path(caches, "numba"), *([Path(given)] if given else [])]
    if any(map(is_writable, folders)):
        return
    import tempfile

    folder = Path(tempfile.gettempdir(), f"geovp-numba-{os.getuid()}")
    if not is_writable(folder) or folder.stat().st_uid != os.getuid():
        folder = Path(tempfile.mkdtemp(prefix="geovp-numba-"))
    os.environ["NUMBA_CACHE_DIR"] = str(folder)


def is_writable(folder: Path) -> bool:
    """Return whether files can be created in a folder, which is created if it does not exist."""
    trial = folder / f".{os.getpid()}.trial"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        trial.touch()
        trial.unlink()
    except OSError:
        return False
    return True
