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

    results = Results(chosen.folder)
    with progress_bar("report", "figures") as progress:
        report.write(results, progress)
    print(results.report)
    return 0
