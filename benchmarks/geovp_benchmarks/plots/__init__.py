"""The figures of a results folder: metrics over the horizon, film strips, paths."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from geovp.drawing.page import Page
from geovp.progress import tracked
from geovp_benchmarks.plots import clips, horizon
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.plots.style import Options
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.statistics import strata
from geovp_benchmarks.tables.table_model import selected_columns

__all__ = ["Options", "write_all"]


def write_all(results: Results, options: Options) -> Iterator[tuple[Page, list[Path]]]:
    """Write all figures, or those of strata or differences, and yield each with its files.

    All figures together replace those of earlier settings. Raise BadData without results.
    """
    material = Material(results, options)
    groups, is_plain = [material], not (options.by or options.against)
    if options.by:
        shown = results.select(*(method.label for method in material.shown))
        groups = [Material(subset, options) for subset in strata.divide(shown, options.by)]
    metrics = horizon.metrics(material)
    tasks = [
        partial(horizon.score_pages, groups, metric)
        for metric in selected_columns(options.metrics, metrics) or metrics
    ]
    has_clips = is_plain and not options.metrics
    for number, name in enumerate(material.clips if has_clips else [], 1):
        tasks.append(partial(clips.clip_pages, material, number, name))
    stems = set()
    for draw in tracked(tasks):
        for page in draw():
            stems.add(page.stem)
            if not options.width_in:
                page.add_titles()
            kinds = [options.format] if options.format else page.formats
            paths = [results.plots / f"{page.stem}.{kind}" for kind in kinds]
            for path in paths:
                page.write(path)
            yield page, paths
    is_whole = is_plain and not (options.metrics or results.selected)
    for path in results.plots.glob("*") if is_whole else []:
        if path.stem not in stems and path.stem.startswith(("horizon-", "strip-", "paths-")):
            path.unlink()
