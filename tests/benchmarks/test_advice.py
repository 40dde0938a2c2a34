"""Messages advise options that the command has: those of data sets are called as the command does."""

import ast
import re
from pathlib import Path

import pytest

from geovp_benchmarks import cli
from geovp_benchmarks.cli import command_line, spelled

ROOT = Path(__file__).resolve().parents[2]
# what `predict` and `display` run, by the folder of the message
SOURCES = [
    path
    for folder in ("geovp_classic/data", "geovp/predict", "benchmarks/geovp_benchmarks/predict")
    for path in sorted((ROOT / folder).rglob("*.py"))
]


def options_of(command: str) -> dict[str, list[str]]:
    """Return the spellings of each option of a command, by its setting."""
    path = ["INPUT"] if command != "poses" else ["ROOT", "FRAMES"]
    parser = command_line()
    return dict(parser.parse_args([command, *path]).options)


def advised(source: str) -> set[str]:
    """Return the options that the strings of a source file name."""
    strings = (node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant))
    texts = (text for text in strings if isinstance(text, str))
    return {name for text in texts for name in re.findall(r"(?<![\w-])--[a-z][a-z-]+", text)}


@pytest.mark.parametrize("command", ["predict", "display"])
def test_advised_options_exist(command: str) -> None:
    names = {name for spellings in options_of(command).values() for name in spellings}
    # of other programs, and of one of the two commands
    elsewhere = {"--image", "--first", "--past", "--matrix", "--method", "--predictor", "--size"}
    elsewhere |= {"--pose-source", "--renderer", "--mask", "--sequence"}
    for path in SOURCES:
        assert advised(path.read_text()) - elsewhere <= names, path


@pytest.mark.parametrize("command", ["predict", "display"])
def test_settings_of_data_sets_are_called_by_their_options(command: str) -> None:
    options = options_of(command)
    for message, expected in (
        ("convert the images, or set image_bits to 12", "convert the images, or set --bits to 12"),
        ("give image_topic, one of /a, /b", "give --topic, one of /a, /b"),
        ("frame_rate_hz is 5: rate_hz = 5 uses", "--fps is 5: --rate 5 uses"),
        ("give intrinsics = [fx, fy, cx, cy]", "give intrinsics = [fx, fy, cx, cy]"),
    ):
        assert spelled(message, options) == expected


def test_other_commands_keep_the_names_of_tables() -> None:
    assert spelled("give image_topic", options_of("poses")) == "give image_topic"
    assert cli.COMMANDS
