"""The figures of a results folder: metric over horizon, film strips, paths from above; one page per figure."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.plots import style
from benchmarks.plots.gather import Page, jobs
from benchmarks.store import Results, write_bytes

__all__ = ["Page", "Progress", "jobs", "rendered", "write_all"]

Progress = Callable[[int, int, str], None]  # (jobs done, jobs in all, what was drawn)
SAVING: dict[str, dict[str, Any]] = {
    "png": {"pil_kwargs": {"compress_level": 2}},
    "jpg": {"pil_kwargs": {"quality": 88, "subsampling": 0}},
    "svg": {"metadata": {"Date": None}},  # the same rows give the same bytes
}
KINDS = ("horizon", "strip", "invented", "paths")


def write_all(results_dir: Path, progress: Progress | None = None) -> list[Path]:
    """Draw every figure into the results folder's plots, png and svg, and remove figures that are out of date.

    BadData when the folder holds no results.
    """
    results = Results(results_dir)
    todo = jobs(results)
    written: list[Path] = []
    for number, job in enumerate(todo, 1):
        for page in job.draw():
            for kind in page.formats:
                path = results.plots / f"{page.name}.{kind}"
                write_bytes(path, rendered(page, kind))
                written.append(path)
        if progress is not None:
            progress(number, len(todo), job.name)
    for kind in KINDS:
        for path in set(results.plots.glob(f"{kind}-*")) - set(written):
            path.unlink()
    return written


def rendered(page: Page, kind: str) -> bytes:
    """The figure as a file of that kind: png, svg or jpg."""
    buffer = io.BytesIO()
    with style.settings():
        page.figure.savefig(buffer, format=kind, dpi="figure", **SAVING.get(kind, {}))
    return buffer.getvalue()
