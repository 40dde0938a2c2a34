"""Arguments that several verbs and studies take."""

from __future__ import annotations

import argparse
import tomllib
from pathlib import Path
from typing import Any

from geovp_classic.errors import BadData


def positive(text: str) -> int:
    """The type of a count."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number of 1 or more")
    return number


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Let a component's fields be set with `--set FIELD=VALUE`, any number of times."""
    help_text = "a setting, written as in TOML"
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", help=help_text)


def settings(chosen: argparse.Namespace, option: str = "set") -> dict[str, Any]:
    """What `--set`, or another such option, was given; BadData when it is not TOML."""
    given = getattr(chosen, option)
    try:
        return tomllib.loads("\n".join(given))
    except tomllib.TOMLDecodeError as error:
        raise BadData(f"--{option} {' '.join(given)!r} is not FIELD=VALUE with a value as in TOML ({error})") from error


def add_results_folder(parser: argparse.ArgumentParser) -> None:
    """Ask for a results folder."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="a results folder that `geovp run` wrote")


def add_division(parser: argparse.ArgumentParser) -> None:
    """Let the clips be divided into strata."""
    help_text = (
        "apart for each kind of clips: turning, speed, step (length), seen (share of pixels seen before), moving"
    )
    parser.add_argument("--by", metavar="KIND", help=help_text)


def add_row(parser: argparse.ArgumentParser, out: str) -> None:
    """Ask for a row of a matrix, and on which clips and into which folder it is studied."""
    parser.add_argument("matrix", type=Path, metavar="MATRIX.toml", help="a matrix file; its metrics are measured")
    help_text = 'the row, as tables name it: "vo+prior + fusion" (needed where there are several)'
    parser.add_argument("--row", metavar="ROW", help=help_text)
    parser.add_argument("--root", type=Path, metavar="DIR", help="the data's root, in place of the file's")
    parser.add_argument("--stride", type=positive, metavar="N", help="frames between two clips' starts")
    parser.add_argument("--limit", type=positive, metavar="N", help="only the first N clips")
    parser.add_argument("--out", type=Path, default=Path(out), metavar="DIR", help=f"where figures go ({out})")
