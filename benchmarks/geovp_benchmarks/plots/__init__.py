"""The figures of a results folder: metric over horizon and over samples, film strips, paths."""

import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import matplotlib.style

from geovp_benchmarks.analysis import strata
from geovp_benchmarks.plots import horizon, kept_clips, style
from geovp_benchmarks.plots.material import Material, Page
from geovp_benchmarks.plots.style import Layout
from geovp_benchmarks.progress import Progress, no_progress, tracked
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables.table_model import EVERYTHING, Choice
from geovp_classic.data.atomic import write_bytes

__all__ = ["Layout", "Page", "figures", "rendered", "write", "write_all"]


def figures(
    results: Results,
    progress: Progress = no_progress,
    by: str | None = None,
    layout: Layout | None = None,
    choice: Choice = EVERYTHING,
) -> Iterator[Page]:
    """Draw all figures, or the curves of strata; raise BadData for a folder without results."""
    layout = layout or Layout()
    drawing = _drawing(results, by, layout, choice)
    for draw in tracked(drawing, len(drawing), progress):
        with matplotlib.style.context(style.SHEET):
            pages = draw()
        yield from (replace(page, formats=layout.formats or page.formats) for page in pages)


def write_all(
    results: Results,
    progress: Progress = no_progress,
    by: str | None = None,
    layout: Layout | None = None,
    choice: Choice = EVERYTHING,
) -> Iterator[tuple[Page, dict[Path, bytes]]]:
    """Write all figures and yield each with its files; remove figures of the same kinds.

    Figures of several methods and metrics alone leave the other figures as they are.
    """
    names: set[str] = set()
    for page in figures(results, progress, by, layout, choice):
        names.add(page.name)
        yield page, write(page, results.plots)
    if choice != EVERYTHING:
        return
    kinds = ("horizon", "samples", "strip", "inpainted", "paths")
    for kind in kinds if by is None else (f"strata-{by}",):
        for path in results.plots.glob(f"{kind}-*"):
            if path.stem not in names:
                path.unlink()


def write(page: Page, folder: Path) -> dict[Path, bytes]:
    """Write one figure in its formats and return its files."""
    files = {folder / f"{page.name}.{kind}": rendered(page, kind) for kind in page.formats}
    for path, content in files.items():
        write_bytes(path, content)
    return files


def rendered(page: Page, kind: str) -> bytes:
    """Encode the figure as png, svg or pdf; the same figure gives the same file."""
    buffer = io.BytesIO()
    # A figure with a layout engine has its text inside its edges and keeps its size.
    extent = "tight" if page.figure.get_layout_engine() is None else page.figure.bbox_inches
    dates = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
    with matplotlib.style.context(style.SHEET):
        page.figure.savefig(
            buffer, format=kind, dpi="figure", bbox_inches=extent, metadata=dates.get(kind)
        )
    return buffer.getvalue()


def _drawing(
    results: Results, by: str | None, layout: Layout, choice: Choice
) -> list[Callable[[], list[Page]]]:
    material = Material.read(results, choice)
    metrics = horizon.metrics(material)
    metrics = choice.columns(metrics, ()) or metrics
    whole = [metric for metric in metrics if "@" not in metric]
    if by is not None:
        subsets = strata.divide(results, by)
        materials = {subset.label: Material.read(subset, choice) for subset in subsets}
        return [partial(horizon.stratum_pages, materials, by, name, layout) for name in whole]
    drawing: list[Callable[[], list[Page]]] = [
        partial(horizon.pages, material, metric, layout) for metric in metrics
    ]
    if any(method.num_samples > 1 for method in material.methods):
        drawing += [partial(horizon.sample_pages, material, name, layout) for name in whole]
    for number, (name, _) in enumerate(results.clips(), 1):
        drawing.append(partial(kept_clips.pages, material, number, name, layout))
    return drawing
