"""Measure forecasters on pose files alone, and fit their constants."""

from __future__ import annotations

import argparse

from benchmarks.cli.study import print_lines
from benchmarks.studies.forecasting import command
from benchmarks.studies.forecasting.command import add_arguments

__all__ = ["add_arguments", "run"]


def run(chosen: argparse.Namespace) -> int:
    """Print the lines of the chosen verb."""
    return print_lines(command.run, chosen)
