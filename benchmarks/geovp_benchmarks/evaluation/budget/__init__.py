"""Where the loss comes from: every stage of one row of a matrix replaced by the truth, alone and
one by one.

Upwards: the forecast with one stage true. One by one: stage after stage, from the forecast to the
truth, so that the changes add up. Downwards: all stages true but one. All are paired differences
over clips with intervals from a block bootstrap. What the stages mean:
`geovp_benchmarks.evaluation.budget.poses` and `.images`.
"""

import argparse
from collections.abc import Iterator

from geovp_benchmarks.arguments import add_method
from geovp_benchmarks.progress import Progress
from geovp_classic.types import PrivilegedInput


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which row of which matrix, and whether right images stand in for recorded depth."""
    add_method(parser, "results/budget")
    help_text = "take the depth of right images for the true one, where there is no recorded depth"
    parser.add_argument("--stereo", action="store_true", help=help_text)


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """The tables and the paths of the figures; BadData for a row that has no stages."""
    from geovp_benchmarks import plots
    from geovp_benchmarks.evaluation.budget import figures, stages
    from geovp_benchmarks.evaluation.budget.scores import Subject

    subject = Subject.read(
        chosen, PrivilegedInput.RIGHT_FRAMES if chosen.stereo else PrivilegedInput.NONE
    )
    budget = stages.measure(subject, progress)
    yield from stages.tables(budget)
    for page in figures.pages(budget):
        yield from map(str, plots.write(page, chosen.out))
