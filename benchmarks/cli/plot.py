"""Draw the figures of a results folder."""

from __future__ import annotations

import argparse

from benchmarks.arguments import add_results_folder as add_arguments
from benchmarks.progress import progress_bar

__all__ = ["add_arguments", "run"]


def run(chosen: argparse.Namespace) -> int:
    """Write the figures and print their paths."""
    from benchmarks import plots
    from benchmarks.store import Results

    with progress_bar("plots", "figures") as progress:
        written = [path for _, files in plots.write_all(Results(chosen.folder), progress) for path in files]
    print(*written, sep="\n")
    return 0
