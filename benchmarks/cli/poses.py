"""Track whole sequences: pose files, drift, and a plot of the path with the ground truth."""

from __future__ import annotations

import argparse

from benchmarks.cli.study import print_lines
from benchmarks.studies import odometry
from benchmarks.studies.odometry import add_arguments

__all__ = ["add_arguments", "run"]


def run(chosen: argparse.Namespace) -> int:
    """Print the lines of the study of odometry, of which this is the short name."""
    return print_lines(odometry.run, chosen)
