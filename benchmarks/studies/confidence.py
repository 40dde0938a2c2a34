"""Whether the confidence of stored predictions ranks their errors, beside what the step alone would
tell.

Spearman's rank correlation with a frame metric over all clips and steps of each row; nothing is
predicted.
"""

import argparse
from collections.abc import Iterator

from geovp_benchmarks.arguments import add_results_folder
from geovp_benchmarks.progress import Progress
from geovp_classic.errors import BadData


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which results, by which metric."""
    add_results_folder(parser)
    parser.add_argument(
        "--metric", default="psnr", metavar="NAME", help="a stored metric with a better (psnr)"
    )


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """The table."""
    from geovp_benchmarks.analysis import confidence
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.results.stored_facts import title
    from geovp_benchmarks.tables.formats import columns

    for part in Results(chosen.folder).by_dataset().values():
        found = confidence.rankings(part, chosen.metric)
        if not found:
            raise BadData(f"{part.root} has no methods with confidences: use other results")
        yield from columns([[*confidence.HEAD], *([*one.texts()] for one in found)])
        yield confidence.NOTE.format(title(chosen.metric))
