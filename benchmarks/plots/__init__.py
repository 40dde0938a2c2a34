"""The figures of a results folder: metric over horizon and samples, film strips, paths; one page per figure."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.plots import horizon, kept_clips, samples, style
from benchmarks.plots.material import Job, Material, Page, data_name, title
from benchmarks.store import Results, write_bytes

__all__ = ["Look", "Page", "Progress", "data_name", "jobs", "rendered", "write_all"]

Progress = Callable[[int, int, str], None]  # (jobs done, jobs in all, what was drawn)
Look = Callable[[Page, Mapping[str, bytes]], None]  # (a figure, its files by kind)
SAVING: dict[str, dict[str, Any]] = {
    "png": {"pil_kwargs": {"compress_level": 2}},
    "jpg": {"pil_kwargs": {"quality": 85}},
    "svg": {"metadata": {"Date": None}},  # the same rows give the same bytes
}
KINDS = ("horizon", "samples", "strip", "invented", "paths")


def jobs(results: Results) -> list[Job]:
    """What there is to draw, ready to be drawn one after the other; BadData when the folder holds no results."""
    material = Material.read(results)
    over_horizon = [
        Job(title(metric), partial(horizon.pages, material, metric)) for metric in horizon.metrics(material)
    ]
    whole = [metric for metric in horizon.metrics(material) if "@" not in metric]
    many = any(cell.num_samples > 1 for cell in material.cells)
    over_samples = [
        Job(f"{title(metric)} of samples", partial(samples.pages, material, metric)) for metric in whole if many
    ]
    by_clip = [
        Job(f"clip {name}", partial(kept_clips.pages, material, number, name))
        for number, (name, _) in enumerate(results.clips(), 1)
    ]
    return over_horizon + over_samples + by_clip


def write_all(results_dir: Path, progress: Progress | None = None, look: Look | None = None) -> list[Path]:
    """Draw every figure into the results folder's plots and remove figures that are out of date.

    All come as png and svg but two: curves over sets of pixels as svg alone, strips of invented pixels as png alone.
    `look` is shown every figure once it is written, so that nobody has to draw it again.

    BadData when the folder holds no results.
    """
    results = Results(results_dir)
    todo = jobs(results)
    written: list[Path] = []
    for number, job in enumerate(todo, 1):
        for page in job.draw():
            files = {kind: rendered(page, kind) for kind in page.formats}
            for kind, content in files.items():
                path = results.plots / f"{page.name}.{kind}"
                write_bytes(path, content)
                written.append(path)
            if look is not None:
                look(page, files)
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
