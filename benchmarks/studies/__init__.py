"""Studies behind the results pages, each with its figures; they are not installed."""

import argparse
import ast
import importlib
import pkgutil
from collections.abc import Sequence
from pathlib import Path

from geovp_benchmarks import cli


def command_line(words: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser of all studies; only those named by a word are imported."""
    parser = argparse.ArgumentParser(
        prog="python benchmarks/studies",
        description="Measurements behind the results pages.",
        parents=[cli.verbosity()],
    )
    studies = parser.add_subparsers(title="studies", metavar="NAME", required=True)
    for module in sorted(pkgutil.iter_modules(__path__)):
        name = module.name.replace("_", "-")
        if name in words:
            study = importlib.import_module(f"{__name__}.{module.name}")
            cli.add_command(studies, name, study)
        elif not name.startswith("-"):
            place = "__init__" if module.ispkg else ""
            path = Path(__path__[0], module.name, place).with_suffix(".py")
            text = ast.get_docstring(ast.parse(path.read_bytes())) or ""
            studies.add_parser(name, help=text.partition("\n")[0].replace("%", "%%"))
    return parser


def main(words: Sequence[str]) -> int:
    """Run a study and return the exit code."""
    return cli.main(words, command_line(words))
