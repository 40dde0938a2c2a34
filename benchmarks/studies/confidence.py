"""Rank correlation of the confidence of stored predictions with their errors.

It is Spearman's, with a frame metric over all clips and steps of each method, beside that of the
step alone.
"""

import argparse
from collections.abc import Iterator

from geovp_benchmarks.analysis import confidence
from geovp_benchmarks.cli.options import add, add_shared
from geovp_benchmarks.progress import Progress
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.results.stored_facts import title
from geovp_benchmarks.tables.formats import grid
from geovp_classic.errors import BadData


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the results and the metric."""
    add_shared(parser, "folder")
    add(parser, "--metric", "METRIC", "Stored frame metric. Default: psnr.", "psnr")


def run(args: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """Yield a table per data set."""
    for results in Results(args.folder).by_dataset().values():
        rankings = confidence.rankings(results, args.metric)
        if not rankings:
            raise BadData(f"{results.root} has no methods with confidences: use other results")
        yield from grid([confidence.HEAD, *(ranking.texts() for ranking in rankings)])
        yield confidence.NOTE.format(title(args.metric))
