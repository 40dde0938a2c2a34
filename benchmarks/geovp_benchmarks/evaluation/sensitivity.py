"""How errors of the camera's pose show in the images: constant offsets of the true future poses
against the scores.

Each offset is about (yaw to the right, pitch up, roll clockwise) or along (x right, y down, z
forward) an axis of the future camera, the same for all future frames, with either sign. Past and
future poses are the recorded ones, refined from the images; the row's renderer is used, its pose
source is not. Nothing is random.
"""

import argparse
from collections.abc import Iterator

from geovp_benchmarks.arguments import add_method
from geovp_benchmarks.progress import Progress
from geovp_classic.types import PrivilegedInput


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Whose renderer, on which clips."""
    add_method(parser, "results/sensitivity")


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """The table and the paths of the figures; Incompatible for poses that are not in metres."""
    from geovp_benchmarks import plots
    from geovp_benchmarks.evaluation.budget import figures, offsets
    from geovp_benchmarks.evaluation.budget.scores import Subject, score

    scores = score(
        Subject.read(chosen, PrivilegedInput.NONE), offsets.ALL, offsets.predict, progress
    )
    yield from offsets.table(scores)
    for page in figures.sensitivity_pages(scores):
        yield from map(str, plots.write(page, chosen.out))
