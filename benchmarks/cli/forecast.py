"""Measure forecasters on pose files alone, and fit their constants."""

from __future__ import annotations

import argparse

from benchmarks.cli.study import print_lines
from benchmarks.studies.forecasting import command


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verbs of the study of forecasting."""
    command.add_arguments(parser)


def run(chosen: argparse.Namespace) -> int:
    """Print the lines of the chosen verb."""
    return print_lines(command.run, chosen)
