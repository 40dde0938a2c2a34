"""Write report.html of a results folder, with its figures."""

from __future__ import annotations

import argparse

from geovp_benchmarks.arguments import add_results_folder as add_arguments
from geovp_benchmarks.progress import progress_bar

__all__ = ["add_arguments", "run"]


def run(chosen: argparse.Namespace) -> int:
    """Write figures and report and print the report's path."""
    from geovp_benchmarks import report
    from geovp_benchmarks.store import Results

    parts = Results(chosen.folder).by_dataset().values()
    with progress_bar("report", "figures") as progress:
        for part in parts:
            report.write(part, progress)
    print(*(part.report for part in parts), sep="\n")
    return 0
