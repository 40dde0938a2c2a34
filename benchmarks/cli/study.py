"""Measure one part by itself, such as depth; prints a table."""

from __future__ import annotations

import argparse
import pkgutil
from collections.abc import Callable, Iterable
from pathlib import Path

from benchmarks import studies
from benchmarks.cli import add_modules
from benchmarks.progress import Progress, progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which of the modules of `benchmarks.studies`."""
    names = [module.name for module in pkgutil.iter_modules(studies.__path__)]
    add_modules(parser, Path(studies.__path__[0]), names, "NAME", "study")


def run(chosen: argparse.Namespace) -> int:
    """Print the lines of the study."""
    return print_lines(chosen.study, chosen)


def print_lines(study: Callable[[argparse.Namespace, Progress], Iterable[str]], chosen: argparse.Namespace) -> int:
    """Print the lines of a study as they are ready, with a progress bar."""
    with progress_bar(study.__module__.rpartition(".")[2], "steps") as progress:
        for line in study(chosen, progress):
            print(line, flush=True)
    return 0
