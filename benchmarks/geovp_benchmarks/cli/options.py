"""Options of the commands: types by metavar, and the options that several commands share."""

import argparse
import math
import tomllib
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix import DEVICE
from geovp_benchmarks.progress import Progress as Progress

Lines = Iterator[str]  # to print
LinesAndCode = Generator[str, None, int]  # to print; returns the exit code
SHARED: dict[str, tuple[Any, ...]] = {  # arguments of `add`
    "matrix": ("MATRIX", "Matrix file, or name of a built-in matrix such as demo."),
    "folder": ("DIR", "Results folder, written by `geovp run`."),
    "--methods": ("METHOD...", "Methods, by their names in tables. Default: all."),
    "--metrics": ("METRIC...", "Metrics, in this order. Default: all."),
    "--by": (
        "ATTRIBUTE",
        "Group clips by turning, speed, step (length), seen (fraction) or moving. Default: none.",
    ),
    "--against": ("METHOD", "Paired differences from this method. Default: means."),
    "--method": ("METHOD", "Method of the matrix, such as 'vo+prior + fusion'. Default: the only."),
    "--root": ("FOLDER", "Folder of the data set. Default: that of the matrix file or run."),
    "--limit": ("N", "Number of clips, from the first on. Default: all."),
    "--set": (
        "KEY=VALUE",
        "Setting of the matrix file, such as protocol.stride=20. May be repeated.",
        [],
        "append",
    ),
    "--keep": (
        "CLIPS",
        "Clips kept for figures: a number, all, or names with commas. Default: 4.",
        "4",
    ),
    "--workers": (
        "WORKERS",
        "Number of processes, or address of a Dask scheduler. Default: 1.",
        "1",
    ),
    "--device": ("DEVICE", "Device of networks: cpu, cuda, cuda:N or auto. Default: cpu."),
}


def add(
    parser: argparse._ActionsContainer,
    name: str,
    metavar: str,
    text: str,
    default: Any = None,
    action: str = "store",
    **more: Any,
) -> None:
    """Add an argument whose type follows from its metavar; METHOD... takes several values."""
    if metavar.endswith("..."):
        metavar, default, more = metavar.removesuffix("..."), (), {"nargs": "+"}
    types: dict[str, Callable[[str], Any]] = {
        "DEVICE": device,
        "DIR": Path,
        "FILE": Path,
        "FOLDER": Path,
        "MATRIX": Path,
        "N": at_least(1),
        "SIZE": size_px,
        "SPEC": spec,
        "WORKERS": executor,
        "X": float,
    }
    more = {"type": types.get(metavar, str), **more}
    parser.add_argument(name, metavar=metavar, help=text, default=default, action=action, **more)


def add_flag(parser: argparse._ActionsContainer, name: str, text: str, **more: Any) -> None:
    """Add an option without a value."""
    parser.add_argument(name, action="store_true", help=text, **more)


def add_group(parser: argparse.ArgumentParser, title: str, *names: str) -> argparse._ArgumentGroup:
    """Add a group with shared arguments, and return it."""
    group = parser.add_argument_group(title)
    add_shared(group, *names)
    return group


def add_shared(parser: argparse._ActionsContainer, *names: str) -> None:
    """Add arguments that several commands share."""
    for name in names:
        add(parser, name, *SHARED[name])


def at_least(minimum: int, kind: type[int] | type[float] = int) -> Callable[[str], Any]:
    """Return the type of an argument: a finite number of at least `minimum`."""

    def number(text: str) -> int | float:
        value = kind(text)
        if not minimum <= value < math.inf:
            raise argparse.ArgumentTypeError(
                f"{text} is not a {'whole ' * (kind is int)}number of {minimum} or more"
            )
        return value

    return number


def device(text: str) -> str:
    """Check the name of a device."""
    if not DEVICE.fullmatch(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not cpu, cuda, cuda:N or auto")
    return text


def executor(text: str) -> dict[str, Any]:
    """Return the table of an executor for a number of processes or the address of a scheduler."""
    if ":" in text:
        return {"name": "dask", "address": text}
    return (
        {"name": "serial"} if text == "1" else {"name": "processes", "workers": at_least(1)(text)}
    )


def spec(text: str) -> dict[str, Any] | str:
    """Parse the name of a component, or its table as in TOML."""
    if not text.startswith("{"):
        return text
    try:
        return dict(tomllib.loads(f"spec = {text}")["spec"])
    except (ValueError, RecursionError) as error:
        raise argparse.ArgumentTypeError(f"{text} is not a table as in TOML ({error})") from error


def size_px(text: str) -> tuple[int, int]:
    """Parse the side of a square, or WIDTHxHEIGHT."""
    width, _, height = text.partition("x")
    side_px = at_least(1)
    return side_px(width), side_px(height or width)
