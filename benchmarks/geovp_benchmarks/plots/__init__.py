"""The figures of a results folder: metric over horizon and over samples, film strips, paths."""

import functools
import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.style
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from geovp_benchmarks.analysis import strata
from geovp_benchmarks.plots import horizon, kept_clips, style
from geovp_benchmarks.plots.layout import Layout
from geovp_benchmarks.plots.material import Material, Page
from geovp_benchmarks.progress import Progress, no_progress, tracked
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables.table_model import EVERYTHING, Choice
from geovp_classic.data.atomic import write_bytes

__all__ = ["Layout", "Page", "figures", "rendered", "write", "write_all"]

SAVE_OPTIONS: dict[str, dict[str, Any]] = {
    "png": {"pil_kwargs": {"compress_level": 2}},
    "pdf": {"metadata": {"CreationDate": None}},
    "svg": {"metadata": {"Date": None}},  # the same rows give the same bytes
}
AS_IT_COMES = Layout()
KINDS = ("horizon", "samples", "strip", "inpainted", "paths")


def figures(
    results: Results,
    progress: Progress = no_progress,
    by: str | None = None,
    layout: Layout = AS_IT_COMES,
    choice: Choice = EVERYTHING,
) -> Iterator[Page]:
    """All figures, or the curves of strata, drawn one after the other; BadData when the folder
    holds no results.
    """
    drawing = _drawing(results, by, layout, choice)
    for draw in tracked(drawing, len(drawing), progress):
        with matplotlib.style.context(style.SHEET):
            pages = draw()
            for page in pages:
                layout.apply(page.figure)
        yield from (replace(page, formats=layout.formats or page.formats) for page in pages)


def _drawing(
    results: Results, by: str | None, layout: Layout, choice: Choice
) -> list[Callable[[], list[Page]]]:
    material = Material.read(results, choice)
    metrics = horizon.metrics(material)
    metrics = choice.columns(metrics, ()) or metrics
    if by is not None:
        parts = {
            subset.label: Material.read(subset, choice) for subset in strata.divide(results, by)
        }
        whole = [metric for metric in metrics if "@" not in metric]
        return [partial(horizon.stratum_pages, parts, by, metric) for metric in whole]
    drawing: list[Callable[[], list[Page]]] = [
        partial(horizon.pages, material, metric) for metric in metrics
    ]
    if any(cell.num_samples > 1 for cell in material.cells):
        drawing += [
            partial(horizon.sample_pages, material, metric)
            for metric in metrics
            if "@" not in metric
        ]
    drawing += [
        partial(kept_clips.pages, material, number, name, layout)
        for number, (name, _) in enumerate(results.clips(), 1)
    ]
    return drawing


def write_all(
    results: Results,
    progress: Progress = no_progress,
    by: str | None = None,
    layout: Layout = AS_IT_COMES,
    choice: Choice = EVERYTHING,
) -> Iterator[tuple[Page, dict[Path, bytes]]]:
    """Write every figure into the results folder's plots, remove those that are no longer drawn;
    each with its files.

    All are png and svg but two: curves over sets of pixels are svg alone, strips of inpainted
    pixels png alone. Where the layout asks for a format, it is that alone. A figure's files of
    other formats stay.

    BadData when the folder holds no results.
    """
    drawn: set[str] = set()
    for page in figures(results, progress, by, layout, choice):
        files = write(page, results.plots)
        drawn.add(page.name)
        yield page, files
    if choice != EVERYTHING:
        return
    for kind in KINDS if by is None else (f"strata-{by}",):
        for path in results.plots.glob(f"{kind}-*"):
            if path.stem not in drawn:
                path.unlink()


def write(page: Page, folder: Path) -> dict[Path, bytes]:
    """Write one figure in its formats; its files."""
    files = {folder / f"{page.name}.{kind}": rendered(page, kind) for kind in page.formats}
    for path, content in files.items():
        write_bytes(path, content)
    return files


def rendered(page: Page, kind: str) -> bytes:
    """The figure as a file of that kind: png, svg or pdf."""
    buffer = io.BytesIO()
    with matplotlib.style.context(style.SHEET):
        extent = _extent(page.figure)
        page.figure.savefig(
            buffer, format=kind, dpi="figure", bbox_inches=extent, **SAVE_OPTIONS.get(kind, {})
        )
    return buffer.getvalue()


@functools.lru_cache(maxsize=1)
def _extent(figure: Figure) -> Bbox:
    """The rectangle of all that is drawn, in inches; to look for it takes half the time that a file
    does.
    """
    return figure.get_tightbbox().padded(matplotlib.rcParams["savefig.pad_inches"])
