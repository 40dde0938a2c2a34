"""Draw the figures of a results folder."""

import argparse

from geovp_benchmarks.arguments import add_choice, add_division, add_results_folder
from geovp_benchmarks.progress import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which results, and which of their figures."""
    add_results_folder(parser)
    add_division(parser)
    add_choice(parser)
    parser.add_argument(
        "--format", choices=("pdf", "svg", "png"), help="of all figures (default: png and svg)"
    )
    parser.add_argument(
        "--width",
        metavar="LENGTH",
        help="of the files: 3.3in, 84mm or 240pt; fonts keep their size",
    )
    parser.add_argument(
        "--no-title",
        action="store_true",
        help="without title and subtitle, for a caption of one's own",
    )


def run(chosen: argparse.Namespace) -> int:
    """Write the figures and print their paths."""
    from geovp_benchmarks import plots
    from geovp_benchmarks.plots import layout
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.tables.table_model import Choice

    choice = Choice(tuple(chosen.methods), tuple(chosen.metrics))
    width = None if chosen.width is None else layout.width_in(chosen.width)
    wanted = plots.Layout((chosen.format,) if chosen.format else (), width, not chosen.no_title)
    with progress_bar("plots", "figures") as progress:
        parts = Results(chosen.folder).by_dataset().values()
        figures = (
            each
            for part in parts
            for each in plots.write_all(part, progress, chosen.by, wanted, choice)
        )
        written = [path for _, files in figures for path in files]
    print(*written, sep="\n")
    return 0
