"""Options of the commands: types by metavar, and the options that several commands share."""

import argparse
import tomllib
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix import DEVICE

Lines = Iterator[str]  # to print
LinesAndCode = Generator[str, None, int]  # to print; returns the exit code


def option(text: str, **settings: Any) -> dict[str, Any]:
    """Return the help and settings of an argument, as for `ArgumentParser.add_argument`."""
    return {"help": text, **settings}


SHARED: dict[str, Any] = {
    "matrix MATRIX": "Matrix file, or name of a built-in matrix such as demo.",
    "folder DIR": "Results folder, written by `geovp run`.",
    "--methods METHOD...": "Methods, by their names in tables. Default: all.",
    "--metrics METRIC...": "Metrics, in this order. Default: all.",
    "--by ATTRIBUTE": (
        "Group clips by turning, speed, step (length), seen, moving or masked (pixels), or a text "
        "of the data set such as kind. Default: none."
    ),
    "--against METHOD": "Paired differences from this method. Default: means.",
    "--method METHOD": "Method of the matrix, such as 'vo+prior + fusion'. Default: the only.",
    "--root FOLDER": "Folder of the data set. Default: that of the matrix file or run.",
    "--limit N": "Number of clips, from the first on. Default: all.",
    "--device DEVICE": "Device of networks: cpu, cuda, cuda:N or auto. Default: cpu.",
    "--set KEY=VALUE": option(
        "Setting of the matrix file, such as protocol.stride=20. May be repeated.",
        default=[],
        action="append",
    ),
    "--rate RATE": option(
        "About how many frames per second to use, or `native` for all. Default: 10 of a faster "
        "video or folder, and of a bag that is predicted or displayed; native for other data.",
        dest="rate_hz",
    ),
    "--every N = 1": option("Use only each Nth of these frames.", dest="frame_step"),
    "--shard I/N": "Compute part I of N of the clips only; other processes compute the others.",
    "--keep CLIPS = 4": "Clips kept for figures: a number, all, or names with commas.",
    "--workers WORKERS = 1": (
        "Number of processes, 0 for this one (for a debugger), or address of a Dask scheduler."
    ),
}


def shared(*names: str) -> dict[str, Any]:
    """Return arguments that several commands share."""
    return {key: value for key, value in SHARED.items() if key.partition(" ")[0] in names}


SELECTION = shared("--methods", "--metrics", "--by", "--against")


def add_groups(parser: argparse.ArgumentParser, groups: Mapping[str, Mapping[str, Any]]) -> None:
    """Add arguments by the titles of their groups; a title may end in "at most one of"."""
    for title, options in groups.items():
        group = parser.add_argument_group(title) if title else parser
        if title.endswith("at most one of"):
            group = group.add_mutually_exclusive_group()
        add_options(group, options)


def add_options(group: argparse._ActionsContainer, options: Mapping[str, Any]) -> None:
    """Add arguments.

    The key is the name with a metavar, from which the type follows, and a default that the help
    states, too: "--limit N = 8". METHOD... takes several values, A|B one of two, and an option
    without a metavar none. The value is the help, or the result of `option`.
    """
    # The type of a value follows from its metavar.
    types: dict[str, Callable[[str], Any]] = {
        "DEVICE": device,
        "DIR": Path,
        "FILE": Path,
        "FOLDER": Path,
        "I/N": shard,
        "INPUT": Path,
        "MATRIX": Path,
        "N": number(1),
        "NUMBER": number(0),
        "P": number(0, 1, float),
        "RATE": rate,
        "S": number(0, 10, float),
        "SIZE": size_px,
        "SPEC": spec,
        "WORKERS": executor,
        "X": float,
    }
    for spelling, about in options.items():
        words, _, default = spelling.partition(" = ")
        name, _, metavar = words.partition(" ")
        # An option without a metavar is a switch.
        settings: dict[str, Any] = {"action": "store_true"}
        if metavar:
            kind = metavar.removesuffix("...")
            settings = {"type": types.get(kind, str), "metavar": kind, "default": default or None}
            if kind != metavar:
                settings |= {"nargs": "+", "default": default.split()}
            if "|" in kind:
                settings["choices"] = kind.split("|")
        # The help states the default.
        settings |= {"help": about} if isinstance(about, str) else about
        if default:
            settings["help"] += f" Default: {default}."
        group.add_argument(name, **settings)


def number(
    low: float, high: float = 1e9, kind: type[int] | type[float] = int
) -> Callable[[str], Any]:
    """Return the type of an argument: a number from `low` to `high`."""
    expected = "a whole number" if kind is int else "a number"

    def parse(text: str) -> int | float:
        with suppress(ValueError):
            if low <= (value := kind(text)) <= high:
                return value
        raise argparse.ArgumentTypeError(f"{text!r} is not {expected} from {low:g} to {high:g}")

    return parse


def rate(text: str) -> float | str:
    """Parse a number of frames per second, or "native"."""
    parse: Callable[[str], float] = number(0.02, 1e4, float)
    return text if text == "native" else parse(text)


def shard(text: str) -> tuple[int, int]:
    """Parse the number of a part and of all parts, such as 3/64."""
    part, slash, count = text.partition("/")
    if not slash:
        raise argparse.ArgumentTypeError(f"{text!r} is not I/N, such as 3/64")
    num_parts = number(1)(count)
    return int(number(1, num_parts)(part)), int(num_parts)


def device(text: str) -> str:
    """Check the name of a device."""
    if not DEVICE.fullmatch(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not cpu, cuda, cuda:N or auto")
    return text


def executor(text: str) -> dict[str, Any]:
    """Return the table of an executor for a number of processes or the address of a scheduler."""
    if ":" in text:
        return {"name": "dask", "address": text}
    return {"name": "processes", "workers": number(1)(text)} if text != "0" else {"name": "serial"}


def spec(text: str) -> dict[str, Any] | str:
    """Parse the name of a component, or its table as in TOML."""
    if not text.startswith("{"):
        return text
    try:
        return dict(tomllib.loads(f"spec = {text}")["spec"])
    except (ValueError, RecursionError) as error:
        raise argparse.ArgumentTypeError(f"{text} is not a table as in TOML ({error})") from error


def root_and_settings(spec: dict[str, Any] | str) -> tuple[Path, dict[str, Any]]:
    """Return the folder and the settings of a data set from its folder, or its table."""
    settings = dict(spec) if isinstance(spec, dict) else {"root": spec}
    root = settings.pop("root", None) or settings.pop("path", ".")
    return Path(str(root)), settings


def size_px(text: str) -> tuple[int, int]:
    """Parse the side of a square, or WIDTHxHEIGHT."""
    width, x, height = text.partition("x")
    side_px = number(1, 8192)
    return side_px(width), side_px(height if x else width)
