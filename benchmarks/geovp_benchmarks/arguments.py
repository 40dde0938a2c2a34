"""Arguments that several verbs and studies take."""

import argparse
import glob
import math
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix import CONFIGS, DEVICE
from geovp_classic.errors import BadData

FIGURES = (".png", ".pdf", ".svg")


def at_least(least: int, kind: type[int] | type[float] = int) -> Callable[[str], Any]:
    """The type of a finite number that is no less."""

    def number(text: str) -> int | float:
        value = kind(text)
        if not least <= value < math.inf:
            raise argparse.ArgumentTypeError(
                f"{text} is not a {'whole ' * (kind is int)}number of {least} or more"
            )
        return value

    return number


positive = at_least(1)


def figure_file(text: str) -> Path:
    """The type of a file that a figure is drawn into."""
    path = Path(text)
    if path.suffix not in FIGURES or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(
            f"{text} is not a file {', '.join(FIGURES)} in a folder that exists"
        )
    return path


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Let a component's fields be set with `--set FIELD=VALUE`, any number of times."""
    help_text = "a setting, written as in TOML"
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", help=help_text)


def settings(chosen: argparse.Namespace, option: str = "set") -> dict[str, Any]:
    """What `--set`, or another such option, was given; BadData when it is not TOML."""
    given = getattr(chosen, option)
    try:
        return tomllib.loads("\n".join(given))
    except (ValueError, RecursionError) as error:
        raise BadData(
            f"--{option} {' '.join(given)!r} is not FIELD=VALUE with a value as in TOML ({error})"
        ) from error


def add_matrix(parser: argparse.ArgumentParser, help_text: str) -> None:
    """Ask for a matrix file, by its path or the name of a built-in one."""
    given = parser.add_argument("matrix", type=Path, metavar="MATRIX", help=help_text)
    complete_with(
        given, lambda: [path.stem for path in CONFIGS.glob("*.toml")] + glob.glob("*.toml")
    )


def complete_with(argument: argparse.Action, words: Callable[[], Iterable[str]]) -> None:
    """Offer words for an argument where the shell completes it (argcomplete asks its attribute
    `completer`).
    """
    argument.completer = lambda **_: words()  # type: ignore[attr-defined]


def add_json(parser: argparse.ArgumentParser) -> None:
    """Let the results be printed as JSON."""
    parser.add_argument(
        "--json", action="store_true", help="print the results as JSON, and nothing else"
    )


def add_results_folder(parser: argparse.ArgumentParser) -> None:
    """Ask for a results folder."""
    parser.add_argument(
        "folder", type=Path, metavar="DIR", help="a results folder that `geovp run` wrote"
    )


def add_device(parser: argparse._ActionsContainer) -> None:
    """Let the device of networks be chosen."""
    help_text = (
        "of networks and LPIPS: cpu, cuda, cuda:N, or auto (a GPU if there is one); a part's "
        "own comes first"
    )
    parser.add_argument("--device", type=_device, metavar="DEVICE", help=help_text)


def _device(text: str) -> str:
    if not DEVICE.fullmatch(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not cpu, cuda, cuda:N or auto")
    return text


def add_division(parser: argparse.ArgumentParser) -> None:
    """Let the clips be divided into strata."""
    help_text = (
        "apart for each kind of clips: turning, speed, step (length), seen (fraction of pixels "
        "seen before), moving"
    )
    parser.add_argument("--by", metavar="KIND", help=help_text)


def add_choice(parser: argparse.ArgumentParser) -> None:
    """Add options that choose methods and metrics."""
    order = "in this order. Default: all"
    parser.add_argument(
        "--methods", nargs="+", default=[], metavar="METHOD", help=f"The methods, {order}."
    )
    parser.add_argument(
        "--metrics", nargs="+", default=[], metavar="COLUMN", help=f"The metrics, {order}."
    )


def add_method(parser: argparse.ArgumentParser) -> None:
    """Add a method of a matrix, and the clips that it is evaluated on."""
    add_matrix(parser, "a matrix file, or a built-in one's name; its metrics are measured")
    text = 'Method, such as "vo+prior + fusion". Default: the only one.'
    parser.add_argument("--method", metavar="METHOD", help=text)
    text = "Root of the data set. Default: that of the matrix."
    parser.add_argument("--root", type=Path, metavar="DIR", help=text)
    text = "Frames between the starts of two clips. Default: that of the matrix."
    parser.add_argument("--stride", type=positive, metavar="N", help=text)
    text = "Number of clips. Default: all."
    parser.add_argument("--limit", type=positive, metavar="N", help=text)
