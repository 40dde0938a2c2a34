"""The command line `geovp VERB ...`: a module a verb, imported only when chosen, so that `--help`
answers at once.

A verb's module exposes `add_arguments(parser)` and `run(chosen)`, which returns the exit code: 0
when all was done, 1 when some of it failed or was skipped, 2 for bad input, with one sentence that
says what to do. Modules of `studies` yield lines instead.
"""

import argparse
import ast
import errno
import importlib
import io
import os
import signal
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from geovp_benchmarks.cli.messages import messages, say
from geovp_benchmarks.progress import progress_bar
from geovp_classic.errors import GeovpError

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # a disk, a quota, a file's largest size
LONGEST = 2000  # of a sentence, which may quote a number of 5,000 digits
DONE, BAD_INPUT, INTERRUPTED = 0, 2, 130  # 1: some methods are not done
VERBS: tuple[str, ...] = (
    "run",
    "table",
    "plot",
    "report",
    "score",
    "reproduce",
    "predict",
    "poses",
    "forecast",
    "budget",
)
VERBS += ("view", "metrics", "verify", "data", "list", "check")
AMOUNTS = (
    ("q", "quiet", "say nothing but errors and results"),
    ("v", "verbose", "log what is done, with the tracebacks of what failed"),
)


class ModuleParser(argparse.ArgumentParser):
    """A parser that asks a module for its arguments when it is about to parse, and stores the
    module's `run`.

    It is stored as `verb` or, of a module that yields lines, as `study`; without a module it is a
    plain parser.
    """

    def __init__(self, *, module: str = "", **options: Any) -> None:
        super().__init__(**options)
        self._module = module
        amount = self.add_mutually_exclusive_group()
        for letter, word, text in AMOUNTS:
            names, default = (f"-{letter}", f"--{word}"), argparse.SUPPRESS
            amount.add_argument(
                *names, dest="amount", action="store_const", const=word, default=default, help=text
            )

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse, with the module's arguments."""
        self.fill()
        return super().parse_known_args(args, namespace)

    def fill(self, words: Sequence[str] = ()) -> None:
        """Add the module's arguments, once, and those of the parsers below that are named by the
        words of a line.
        """
        if self._module:
            module = importlib.import_module(self._module)
            module.add_arguments(self)
            is_verb = self._module.startswith(f"{__name__}.")
            self.set_defaults(**{"verb" if is_verb else "study": module.run})
            self._module = ""
        choices = [action.choices for action in self._actions if isinstance(action.choices, dict)]
        for below in [parsers[word] for parsers in choices for word in words if word in parsers]:
            below.fill(words)


def add_modules(parser: argparse.ArgumentParser, modules: Mapping[str, str], metavar: str) -> None:
    """One of the modules in `benchmarks`, by their words on the command line, has to be chosen;
    docstrings are help.
    """
    chosen = parser.add_subparsers(metavar=metavar, required=True, parser_class=ModuleParser)
    for word, module in modules.items():
        path = Path(__file__).parents[2].joinpath(*module.split("."))
        text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text(
            encoding="utf-8"
        )
        description = (ast.get_docstring(ast.parse(text)) or "").replace("%", "%%")
        chosen.add_parser(
            word, help=description.partition("\n")[0], description=description, module=module
        )


def print_study(chosen: argparse.Namespace) -> int:
    """Print the lines of a study as they are ready, with a progress bar."""
    with progress_bar(chosen.study.__module__.rpartition(".")[2], "steps") as progress:
        for line in chosen.study(chosen, progress):
            print(line, flush=True)
    return DONE


class PrintVersion(argparse.Action):
    """Look the version up only when it is asked for."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        """Print and end."""
        from importlib import metadata

        print(f"geovp {metadata.version('geovp-classic')}")
        parser.exit()


def command_line() -> ModuleParser:
    """The parser of all verbs."""
    parser = ModuleParser(
        prog="geovp", description="Geometry-based video prediction: run, measure, look."
    )
    parser.set_defaults(amount="normal")
    parser.add_argument("--version", action=PrintVersion, help="print the version and exit")
    parser.epilog = "Exit code: 0 all done, 1 something failed or was skipped, 2 bad input."
    modules = {verb: f"geovp_benchmarks.cli.{verb}" for verb in VERBS}
    add_modules(parser, modules, "VERB")
    return parser


def main(given: Sequence[str] | None = None, parser: ModuleParser | None = None) -> int:
    """Run the chosen verb, or that of another parser, and return the exit code."""
    _open_closed_streams()
    parser = parser or command_line()
    if "_ARGCOMPLETE" in os.environ:  # the shell asks what may stand next
        import argcomplete

        parser.fill(
            os.environ.get("COMP_LINE", "").split()
        )  # argcomplete knows only what is there before it looks
        argcomplete.autocomplete(parser)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(
            stream, io.TextIOWrapper
        ):  # a name that is no text in the terminal's encoding is printed escaped
            stream.reconfigure(errors="backslashreplace")
    chosen = parser.parse_args(given)
    is_main_thread = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGTERM, _interrupt) if is_main_thread else None
    try:
        with messages(chosen.amount):
            return _run(chosen)
    finally:
        if is_main_thread:
            signal.signal(signal.SIGTERM, before)


def _run(chosen: argparse.Namespace) -> int:
    """Run the verb; what can be said in a sentence is."""
    try:
        code = int(getattr(chosen, "verb", print_study)(chosen))
        sys.stdout.flush()
        return code
    except GeovpError as error:
        say.info("where it was found", exc_info=True)
        sentence = " ".join(str(error).split())
        say.error(sentence if len(sentence) <= LONGEST else f"{sentence[:LONGEST]} ...")
        return BAD_INPUT
    except KeyboardInterrupt:
        say.error("interrupted; what was done is kept, the same command goes on from there")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has seen enough
        _discard_output()
        return DONE
    except OSError as error:
        advice = "fix the path or the disk and rerun: finished work is kept"
        if error.errno in FULL:
            advice = (
                "finished parts are kept: make room there and give the same command again, it "
                "goes on from there"
            )
        say.error(f"{error.strerror or error}: {error.filename or 'a file'}: {advice}")
        _discard_output()
        return BAD_INPUT


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def _open_closed_streams() -> None:
    """Open the null device for closed standard streams, whose numbers other files would get."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    sys.stdout = sys.stdout or os.fdopen(1, "w")
    sys.stderr = sys.stderr or os.fdopen(2, "w")


def _discard_output() -> None:
    """Send what standard output still holds to the null device, or Python would fail at its end."""
    null = os.open(os.devnull, os.O_WRONLY)
    with suppress(OSError, ValueError):
        os.dup2(null, sys.stdout.fileno())
    os.close(null)
