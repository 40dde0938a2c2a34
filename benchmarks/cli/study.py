"""Measure one part by itself, such as depth; prints a table."""

from __future__ import annotations

import argparse
import pkgutil

from benchmarks import studies
from benchmarks.cli import add_modules
from benchmarks.cli import print_study as run

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which of the modules of `benchmarks.studies`."""
    names = [module.name for module in pkgutil.iter_modules(studies.__path__)]
    add_modules(parser, {name.replace("_", "-"): f"benchmarks.studies.{name}" for name in names}, "NAME")
