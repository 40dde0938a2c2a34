"""Command line `geovp COMMAND ...`, with one module per command.

A module exposes ARGUMENTS, as `add_groups` takes them, and `run(args)`, which yields the
lines to print and returns the exit code. Its docstring is the help of the command; the part below
"Examples:" is printed after the options.
"""

import argparse
import importlib
import io
import os
import re
import signal
import sys
import textwrap
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from types import ModuleType
from typing import Any, TextIO

from geovp.progress import print_line, progress_bar
from geovp_benchmarks.cli.messages import logger, messages
from geovp_benchmarks.cli.options import add_groups
from geovp_classic.errors import GeovpError, install_command

COMMANDS = (
    "run",
    "merge",
    "rescore",
    "score",
    "reproduce",
    "table",
    "plot",
    "report",
    "compare",
    "export",
    "predict",
    "display",
    "poses",
    "forecast",
    "budget",
    "verify",
    "doctor",
    "list",
    "check",
)


def verbosity() -> argparse.ArgumentParser:
    """Return the parser of the options that may stand before or after any command."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    group = parser.add_argument_group("messages, with each command")
    group.add_argument("-q", "--quiet", action="store_true", help="Print errors and results only.")
    group.add_argument(
        "-v", "--verbose", action="store_true", help="Log all steps, and tracebacks of failures."
    )
    return parser


def command_line(names: Sequence[str] = COMMANDS) -> argparse.ArgumentParser:
    """Return the parser of commands; that of a single one takes less time than that of all."""
    parser = argparse.ArgumentParser(
        prog="geovp",
        description="Geometry-based video prediction: predict, measure and compare.",
        epilog="Exit code: 0 everything done, 1 something failed or was skipped, 2 bad input.",
        parents=[verbosity()],
    )
    if len(names) > 1:  # else no version was asked for, which takes a twentieth of a table to find
        from importlib import metadata

        version = f"geovp {metadata.version('geovp')}"
        parser.add_argument(
            "--version", action="version", version=version, help="Print the version."
        )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name in names:
        add_command(commands, name, importlib.import_module(f"{__name__}.{name}"))
    return parser


def add_command(commands: Any, name: str, module: ModuleType) -> None:
    """Add the parser of a command, with its help and examples from the module's docstring."""
    text = (module.__doc__ or "").replace("%", "%%")
    description, _, examples = text.partition("\nExamples:\n")
    command: argparse.ArgumentParser = commands.add_parser(
        name,
        help=description.partition("\n")[0],
        description=description,
        epilog=f"examples:\n{examples}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_groups(command, module.ARGUMENTS)
    options = {action.dest: action.option_strings[-1:] for action in command._actions}
    command.set_defaults(run=module.run, command=name, options=options)


def spelled(message: str, options: Mapping[str, Sequence[str]], line: str = "") -> str:
    """Return a message in which settings are called by the options of the command.

    Those of data sets, such as `image_topic`, are `--topic` there. Fields of a table, which have
    quotes or a path before them, or stand in the command line, keep their names.
    """
    for setting, names in options.items():
        if "_" in setting and names and setting not in line:
            message = re.sub(rf"(?<!['.])\b{setting}\b( =)?", names[0], message)
    return message


def main(words: Sequence[str] | None = None, parser: argparse.ArgumentParser | None = None) -> int:
    """Run the command of a line, by default one of `geovp`, and return the exit code."""
    open_closed_streams()
    if "_ARGCOMPLETE" in os.environ:  # the shell completes a line
        import argcomplete

        argcomplete.autocomplete(parser or command_line())
    # Options of messages may stand anywhere; the others belong to one command.
    args, rest = verbosity().parse_known_args(words)
    parser = parser or command_line(rest[:1] if {*rest[:1]} & {*COMMANDS} else COMMANDS)
    parser.parse_args(rest, args)
    # Errors of the user are one sentence; SIGTERM ends a command like an interrupt.
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    interrupt = interrupt_once()
    for number, handler in handlers.items():
        if handler != signal.SIG_IGN:  # as in the background of a shell
            signal.signal(number, interrupt)
    code = 2
    note = ", finished work is kept" if args.command in ("run", "reproduce", "score") else ""
    with messages(args.quiet, args.verbose):
        try:
            code = print_lines(args)
        except GeovpError as error:
            logger.info("error raised here", exc_info=True)
            message = spelled(str(error), args.options, " ".join(rest))
            logger.error(textwrap.shorten(message, 2000))
        except ModuleNotFoundError as error:
            from geovp_classic.registry import EXTRA_OF_MODULE

            if error.name not in EXTRA_OF_MODULE:
                raise
            logger.error(f"{error}: {install_command(EXTRA_OF_MODULE[error.name])}")
        except KeyboardInterrupt:
            logger.error("interrupted" + note)
            code = 130
        except OSError as error:
            logger.error(
                f"{error.strerror or error}: {error.filename or 'a file'}: fix the path or make "
                f"room and rerun{note}"
            )
        except MemoryError as error:
            logger.error(f"not enough memory ({error}): give a smaller --size or fewer frames")
        finally:
            for stream in (sys.stdout, sys.stderr):
                flush_or_discard(stream)
            if code == 130 and words is None:  # Python may end such a process by a signal
                os._exit(code)
            for number, handler in handlers.items():
                signal.signal(number, handler)
    return code


def interrupt_once(grace_s: float = 10.0) -> Callable[..., None]:
    """Return a handler of signals that interrupts a command, which then stores what it has.

    Further signals are ignored meanwhile; if that takes long, they end the process at once.
    """
    first_s = None

    def handle(*_: object) -> None:
        nonlocal first_s
        if first_s is None:
            first_s = time.monotonic()
            raise KeyboardInterrupt
        if time.monotonic() - first_s > grace_s:
            os._exit(130)

    return handle


def print_lines(args: argparse.Namespace) -> int:
    """Print the lines of a command as they are ready, and return its exit code.

    The command goes on if nobody reads them, such as after `| head -1`.
    """
    with progress_bar(args.command):
        lines = args.run(args)
        while True:
            try:
                line = next(lines)
            except StopIteration as end:
                return end.value or 0
            try:
                print_line(line, sys.stdout)
                sys.stdout.flush()
            except BrokenPipeError:
                flush_or_discard(sys.stdout)


def flush_or_discard(stream: TextIO) -> None:
    """Write what a stream holds; if that fails, discard it and all that follows.

    Python flushes the standard streams at exit, and would replace the exit code by 120.
    """
    try:
        stream.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, stream.fileno())
            os.close(null)


def open_closed_streams() -> None:
    """Open the null device for closed standard streams; other files would get their numbers."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    sys.stdout = sys.stdout or os.fdopen(1, "w")
    sys.stderr = sys.stderr or os.fdopen(2, "w")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # file names may lack a character of the terminal
            stream.reconfigure(errors="backslashreplace")
