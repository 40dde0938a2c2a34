"""The command line `geovp VERB ...`: a module a verb, imported only when chosen, so that `--help` answers at once.

A verb's module exposes `add_arguments(parser)` and `run(chosen)`, which returns the exit code: 0 when all was done, 1
when some of it failed or was skipped, 2 for bad input, with one sentence that says what to do.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from geovp_classic.errors import GeovpError

DONE, INCOMPLETE, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
VERBS = ("run", "table", "plot", "report", "score", "predict", "poses", "forecast", "study", "data", "list", "check")


class ModuleParser(argparse.ArgumentParser):
    """A parser that asks a module for its arguments when it is about to parse, and stores the module's `run`."""

    def __init__(self, *, module: str = "", dest: str = "", **options: Any) -> None:
        """`dest` is where `run` is stored; without a module it is a plain parser."""
        super().__init__(**options)
        self._module, self._dest = module, dest

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse, with the module's arguments."""
        if self._module:
            module = importlib.import_module(self._module)
            module.add_arguments(self)
            self.set_defaults(**{self._dest: module.run})
        return super().parse_known_args(args, namespace)


def add_modules(parser: argparse.ArgumentParser, package: Path, names: Iterable[str], metavar: str, dest: str) -> None:
    """One of the modules of a package in `benchmarks` has to be chosen; their docstrings are the help."""
    chosen = parser.add_subparsers(metavar=metavar, required=True, parser_class=ModuleParser)
    for name in names:
        file = package / f"{name}.py"
        text = (file if file.exists() else package / name / "__init__.py").read_text(encoding="utf-8")
        description = (ast.get_docstring(ast.parse(text)) or "").replace("%", "%%")
        module = f"benchmarks.{package.name}.{name}"
        summary = description.partition("\n")[0]
        chosen.add_parser(name.replace("_", "-"), help=summary, description=description, module=module, dest=dest)


def main(given: Sequence[str] | None = None) -> int:
    """Run the chosen verb and return the exit code."""
    parser = argparse.ArgumentParser(prog="geovp", description="Geometry-based video prediction: run, measure, look.")
    parser.epilog = "Exit code: 0 all done, 1 something failed or was skipped, 2 bad input."
    add_modules(parser, Path(__file__).parent, VERBS, "VERB", "verb")
    chosen = parser.parse_args(given)
    try:
        return int(chosen.verb(chosen))
    except GeovpError as error:
        print(f"geovp: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("\ngeovp: interrupted; what was done is kept, the same command goes on from there", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has seen enough
        sys.stderr.close()
        return DONE
