"""Write report.html of a results folder, with its figures."""

import argparse

from geovp_benchmarks.arguments import add_choice, add_results_folder
from geovp_benchmarks.progress import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which results, and what they are compared with."""
    add_results_folder(parser)
    add_choice(parser)
    help_text = "also paired differences of all methods from this one, marked where significant"
    parser.add_argument("--against", metavar="METHOD", help=help_text)


def run(chosen: argparse.Namespace) -> int:
    """Write figures and report and print the report's path."""
    from geovp_benchmarks import report
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.tables.table_model import Choice

    choice = Choice(tuple(chosen.methods), tuple(chosen.metrics))
    parts = Results(chosen.folder).by_dataset().values()
    with progress_bar("report", "figures") as progress:
        for part in parts:
            report.write(part, progress, chosen.against, choice)
    print(*(part.report for part in parts), sep="\n")
    return 0
