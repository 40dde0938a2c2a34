"""Write report.html of a results folder."""

from __future__ import annotations

import argparse

from benchmarks.arguments import add_results_folder as add_arguments
from benchmarks.progress import Bar

__all__ = ["add_arguments", "run"]


def run(chosen: argparse.Namespace) -> int:
    """Write the report and print its path."""
    from benchmarks import report

    with Bar("report", "figures") as bar:
        print(report.write(chosen.folder, bar.show))
    return 0
