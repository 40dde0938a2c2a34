"""Reliability diagram of forecasters on windows of pose files.

A curve shows how often the true state lies in the region to which a forecast assigns a probability:
in (x, z, yaw), in height, pitch and roll over the plane, and in all six components. Below the
diagonal, regions are too small.
"""

import argparse
from collections.abc import Iterator

from geovp_benchmarks.cli.options import Progress, add
from geovp_benchmarks.evaluation import forecasting
from geovp_classic import registry
from studies._figures import panels


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the pose files and the figure."""
    add(parser, "poses", "FOLDER", "Folder of NN.txt and NN_times.txt.")
    add(parser, "figure", "FILE", "File of the figure: png, pdf or svg.")
    add(parser, "--stride", "N", "Frames between the starts of two windows. Default: 10.", 10)


def run(args: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """Draw the diagram of damped CTRA and the motion prior on the test sequences."""
    test = ("03", "05", "06", "07", "10")
    windows = forecasting.read_windows(args.poses, test, stride=args.stride)
    probabilities = [round(0.05 * k, 2) for k in range(1, 20)]
    scores = {
        name: forecasting.evaluate(
            windows, registry.build("forecasters", name), progress, probabilities
        )
        for name in ("acceleration-kalman", "motion-prior")
    }
    names = ("x, z, yaw", "height", "pitch", "roll", "all six")
    with panels(args.figure, (8.5, 2.1), len(names)) as drawn:
        for axes, title in zip(drawn, names, strict=True):
            axes.plot([0, 1], [0, 1], color="0.5", linewidth=0.8)
            axes.set(title=title, xlabel="probability", aspect="equal")
            for (name, each), dash in zip(scores.items(), ("-", "--"), strict=True):
                inside = [each[f"{title} in {region:.0%}"].mean() for region in probabilities]
                axes.plot(probabilities, inside, dash, label=name)
        drawn[0].set_ylabel("fraction of true states inside")
    yield f"{len(windows)} windows of {', '.join(test)}: {args.figure}"
