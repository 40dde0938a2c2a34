"""Messages advise options that the command has: those of data sets are called as the command does."""

import ast
import dataclasses
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_benchmarks import cli
from geovp_benchmarks.cli import command_line, spelled
from geovp_classic.data.layouts import detection
from tests.benchmarks.conftest import Command

ROOT = Path(__file__).resolve().parents[2]
# the command that raises the messages of a folder, a file or a function of it
SOURCES = [
    ("predict", "geovp_classic/data", None),
    ("doctor", "geovp_classic/data", None),
    ("predict", "geovp/prediction", None),
    ("display", "geovp_classic/data", None),
    ("display", "geovp/display", None),
    ("display", "geovp/prediction/camera.py", None),
    ("display", "geovp/prediction/prediction.py", "read_recording"),
    *(
        (path.stem, f"benchmarks/geovp_benchmarks/cli/{path.name}", "run")
        for path in sorted((ROOT / "benchmarks/geovp_benchmarks/cli").glob("*.py"))
        if path.stem in cli.COMMANDS
    ),
]


def options_of(command: str) -> dict[str, list[str]]:
    """Return the spellings of each option of a command, by its setting."""
    path = ["INPUT"] if command != "poses" else ["ROOT", "FRAMES"]
    parser = command_line()
    return dict(parser.parse_args([command, *path]).options)


def advised(
    place: str, function: str | None = None, pattern: str = r"(?<![\w-])--[a-z][a-z-]+(?![\w-])"
) -> set[str]:
    """Return the options that the messages of a folder, a file or a function of it name."""
    path = ROOT / place
    names = set()
    for file in sorted(path.rglob("*.py")) or [path]:
        for node in ast.parse(file.read_text()).body:
            if function is None or getattr(node, "name", None) == function:
                texts = [each.value for each in ast.walk(node) if isinstance(each, ast.Constant)]
                for text in filter(lambda text: isinstance(text, str), texts):
                    # COLMAP's own options have an underscore
                    names |= set(re.findall(pattern, text))
    return names


@pytest.mark.parametrize(("command", "place", "function"), SOURCES)
def test_advised_options_exist(command: str, place: str, function: str | None) -> None:
    parser = command_line()
    commands = next(each.choices for each in parser._actions if isinstance(each.choices, dict))
    names = {name for action in commands[command]._actions for name in action.option_strings}
    assert advised(place, function) <= names


@pytest.mark.parametrize("command", ["predict", "display"])
def test_settings_of_data_sets_are_called_by_their_options(command: str) -> None:
    options = options_of(command)
    for message, expected in (
        ("convert the images, or set image_bits to 12", "convert the images, or set --bits to 12"),
        ("give image_topic, one of /a, /b", "give --topic, one of /a, /b"),
        ("frame_rate_hz is 5: rate_hz = 5 uses", "--fps is 5: --rate 5 uses"),
        ("'x' has no field 'name_pattern'", "'x' has no field 'name_pattern'"),
        ("give intrinsics = [fx, fy, cx, cy]", "give intrinsics = [fx, fy, cx, cy]"),
    ):
        assert spelled(message, options) == expected


def test_settings_that_data_sets_advise_can_be_given() -> None:
    """By an option of predict and display, which read no poses, or in the doctor's table."""
    article = r"(?: an?| the| another| larger| smaller)*"
    named = advised("geovp_classic/data", pattern=rf"(?:give|set|out){article} ([a-z]+_[a-z_]+)")
    assert {"image_bits", "image_topic", "name_pattern", "frame_rate_hz"} <= named
    kinds = detection.LAYOUTS.values()
    fields = {field.name for kind in kinds for field in dataclasses.fields(kind)}
    assert named <= fields
    for command in ("predict", "display"):
        assert named <= options_of(command).keys() | {"body_frame"}


def test_the_doctor_takes_the_settings_that_it_advises(tmp_path: Path, command: Command) -> None:
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((24, 32), 4000, np.uint16))
    refused = command("doctor", tmp_path)
    assert refused.code == 1
    table = f'{{root = "{tmp_path}", image_bits = ...}}'
    assert f"give settings as in: geovp doctor '{table}'" in refused.out
    assert command("doctor", table.replace("...", "12")).code == 0
    assert (
        "'folder' has no field 'bits'"
        in command("doctor", f'{{root = "{tmp_path}", bits = 12}}').err
    )
    assert "5 does not exist" in command("doctor", "{root = 5}").err


def test_other_commands_keep_the_names_of_tables() -> None:
    assert spelled("give image_topic", options_of("poses")) == "give image_topic"
    line = "{root = 'x', frame_step = 0}"
    assert spelled("frame_step is 0", options_of("poses"), line) == "frame_step is 0"
