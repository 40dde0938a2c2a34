"""One self-contained page about a results folder: numbers, figures, settings, and the status of each cell."""

from __future__ import annotations

from pathlib import Path

from benchmarks import plots
from benchmarks.progress import Progress, no_progress
from benchmarks.report import markup, sections
from benchmarks.store import Results
from geovp_classic.data.atomic import write_bytes


def write(results_dir: Path, progress: Progress = no_progress) -> Path:
    """Write report.html, with figures drawn from the stored rows; BadData when the folder holds no results."""
    results = Results(results_dir)
    return _write(results, [sections.Drawn.of(page, {}) for page in plots.figures(results, progress)])


def write_with_plots(results_dir: Path, progress: Progress = no_progress) -> Path:
    """Write the results folder's plots and report.html, every figure drawn once; BadData as `write`."""
    figures: list[sections.Drawn] = []
    plots.write_all(results_dir, progress, lambda page, files: figures.append(sections.Drawn.of(page, files)))
    return _write(Results(results_dir), figures)


def _write(results: Results, figures: list[sections.Drawn]) -> Path:
    facts = sections.Facts.read(results)
    chapters = [
        ("Scores", sections.scores(facts)),
        ("Over the horizon", sections.horizon(figures)),
        ("Clips", sections.clips(figures)),
        ("Methods", sections.methods(facts)),
        ("Protocol", sections.protocol(facts)),
    ]
    filled = [(title, inside) for title, inside in chapters if inside]
    opening = sections.opening(facts, [title for title, _ in filled])
    page = markup.page(str(facts.protocol["name"]), opening, *(sections.chapter(*each) for each in filled))
    write_bytes(results.report, page.encode())
    return results.report
