"""Settings of the whole suite: property tests never fail for slowness, only for being wrong.

Where CI is set, they try the same examples every time, so that a checkout passes or fails whenever it is run; on a
developer's machine they go on looking for new ones.
"""

import os
from pathlib import Path

import pytest
from hypothesis import settings

import geovp_classic

settings.register_profile("geovp", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("geovp")


def pytest_configure(config: pytest.Config) -> None:
    """Forget compiled code that is older than any compiled source: numba's cache only knows a function's own file."""
    if hasattr(config, "workerinput"):  # the process that starts the workers has done it
        return
    package = Path(geovp_classic.__file__).parent
    sources = [path for path in package.rglob("*.py") if "numba" in path.read_text(encoding="utf-8")]
    newest = max(path.stat().st_mtime for path in sources)
    for index in package.rglob("*.nbi"):
        if index.stat().st_mtime < newest:
            index.unlink()
