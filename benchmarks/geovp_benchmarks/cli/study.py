"""Measure one part by itself, such as depth; prints a table."""

import argparse
import pkgutil

from geovp_benchmarks import studies
from geovp_benchmarks.cli import add_modules
from geovp_benchmarks.cli import print_study as run

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which of the modules of `geovp_benchmarks.studies`."""
    names = [module.name for module in pkgutil.iter_modules(studies.__path__)]
    add_modules(
        parser,
        {name.replace("_", "-"): f"geovp_benchmarks.studies.{name}" for name in names},
        "NAME",
    )
