"""One self-contained HTML page about a results folder: scores, figures, settings, and the status of
each cell.
"""

from geovp_benchmarks import plots
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.progress import Progress, no_progress
from geovp_benchmarks.report import films, markup, sections
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables import tables
from geovp_classic.data.atomic import write_bytes


def write(results: Results, progress: Progress = no_progress, against: str | None = None) -> None:
    """Write the results folder's plots and report.html; BadData when the folder holds no results.

    With the name of a row also the differences of all others from it, and which of them are
    significant.
    """
    compared = None if against is None else tables.against(results, against)
    figures = sections.EmbeddedFigure.all(plots.write_all(results, progress))
    protocol, cells = results.protocol(), results.cells()
    chapters = {
        "Scores": sections.scores(tables.build(results), compared),
        "Over the horizon": sections.horizon(figures),
        "Confidence": sections.confidence(results),
        "Clips": films.browser(Material.read(results), sections.paths(figures)),
        "Methods": sections.methods(cells, len(protocol["clips"])),
        "Protocol": sections.protocol(protocol),
    }
    filled = {title: content for title, content in chapters.items() if content}
    body = [
        sections.opening(protocol, cells, filled),
        *(sections.chapter(*each) for each in filled.items()),
    ]
    write_bytes(results.report, markup.page(str(protocol["name"]), *body).encode())
