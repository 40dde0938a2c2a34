"""Messages advise options that the command has: those of data sets are called as the command does."""

import ast
import re
from pathlib import Path

import pytest

from geovp_benchmarks.cli import command_line, spelled, verbosity

ROOT = Path(__file__).resolve().parents[2]


def options_of(command: str) -> dict[str, list[str]]:
    """Return the spellings of each option of a command, by its setting."""
    path = ["INPUT"] if command != "poses" else ["ROOT", "FRAMES"]
    parser = command_line()
    return dict(parser.parse_args([command, *path]).options)


def advised(folder: str) -> set[str]:
    """Return the options that the messages of a package name."""
    names = set()
    for file in sorted((ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                # COLMAP's own options have an underscore
                names |= set(re.findall(r"(?<![\w-])--[a-z][a-z-]+(?![\w-])", node.value))
    return names


def test_all_packages_advise_options_of_some_command() -> None:
    commands = next(each.choices for each in command_line()._actions if each.choices is not None)
    actions = [action for parser in commands.values() for action in parser._actions]
    names = {name for action in actions for name in action.option_strings}
    named = advised("geovp_classic") | advised("geovp")
    names |= {name for action in verbosity()._actions for name in action.option_strings}
    assert {"--fov", "--camera-height", "--topic"} <= named <= names


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
