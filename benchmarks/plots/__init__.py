"""The figures of a results folder: metric over horizon and samples, film strips, paths; one page per figure."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.plots import horizon, kept_clips, style
from benchmarks.plots.material import Material, Page
from benchmarks.progress import Progress, no_progress, tracked
from benchmarks.store import Results
from geovp_classic.data.atomic import write_bytes

__all__ = ["Page", "figures", "rendered", "write_all"]

OnFigure = Callable[[Page, Mapping[str, bytes]], None]  # (a figure, its files by kind)
SAVING: dict[str, dict[str, Any]] = {
    "png": {"pil_kwargs": {"compress_level": 2}},
    "jpg": {"pil_kwargs": {"quality": 85}},
    "svg": {"metadata": {"Date": None}},  # the same rows give the same bytes
}
KINDS = ("horizon", "samples", "strip", "invented", "paths")


def figures(results: Results, progress: Progress = no_progress) -> Iterator[Page]:
    """All figures, drawn one after the other; BadData when the folder holds no results."""
    material = Material.read(results)
    metrics = horizon.metrics(material)
    drawing: list[Callable[[], list[Page]]] = [partial(horizon.pages, material, metric) for metric in metrics]
    if any(cell.num_samples > 1 for cell in material.cells):
        drawing += [partial(horizon.sample_pages, material, metric) for metric in metrics if "@" not in metric]
    drawing += [
        partial(kept_clips.pages, material, number, name) for number, (name, _) in enumerate(results.clips(), 1)
    ]
    for draw in tracked(drawing, len(drawing), progress):
        with style.settings():
            pages = draw()
        yield from pages


def write_all(
    results_dir: Path, progress: Progress = no_progress, on_figure: OnFigure = lambda page, files: None
) -> list[Path]:
    """Draw every figure into the results folder's plots and remove figures that are out of date.

    All come as png and svg but two: curves over sets of pixels as svg alone, strips of invented pixels as png alone.
    `on_figure` is called with every figure once it is written, so that nobody has to draw it again.

    BadData when the folder holds no results.
    """
    results = Results(results_dir)
    written: list[Path] = []
    for page in figures(results, progress):
        files = {kind: rendered(page, kind) for kind in page.formats}
        for kind, content in files.items():
            written.append(results.plots / f"{page.name}.{kind}")
            write_bytes(written[-1], content)
        on_figure(page, files)
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
