"""Draw the figures of a results folder."""

from __future__ import annotations

import argparse

from geovp_benchmarks.arguments import add_division, add_results_folder
from geovp_benchmarks.progress import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which results, and which of their figures."""
    add_results_folder(parser)
    add_division(parser)


def run(chosen: argparse.Namespace) -> int:
    """Write the figures and print their paths."""
    from geovp_benchmarks import plots
    from geovp_benchmarks.store import Results

    with progress_bar("plots", "figures") as progress:
        parts = Results(chosen.folder).by_dataset().values()
        figures = (each for part in parts for each in plots.write_all(part, progress, chosen.by))
        written = [path for _, files in figures for path in files]
    print(*written, sep="\n")
    return 0
