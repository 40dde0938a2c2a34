"""Studies behind the results pages, each with its figures; they are not installed."""

import argparse
import importlib
import pkgutil
from collections.abc import Sequence

from geovp_benchmarks import cli


def command_line() -> argparse.ArgumentParser:
    """Return the parser of all studies."""
    parser = argparse.ArgumentParser(
        prog="python benchmarks/studies",
        description="Measurements behind the results pages.",
        parents=[cli.verbosity()],
    )
    studies = parser.add_subparsers(title="studies", metavar="NAME", required=True)
    for module in pkgutil.iter_modules(__path__):
        if not module.name.startswith("_"):
            study = importlib.import_module(f"{__name__}.{module.name}")
            cli.add_command(studies, module.name.replace("_", "-"), study)
    return parser


def main(words: Sequence[str]) -> int:
    """Run a study and return the exit code."""
    return cli.main(words, command_line())
