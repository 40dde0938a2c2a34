"""The page of the command line is complete, and its examples are accepted."""

import argparse
import importlib.util
import re
import shlex
from pathlib import Path
from types import ModuleType

import pytest

from geovp_benchmarks import cli
from geovp_benchmarks.cli.options import add_groups

DOCS = Path(__file__).resolve().parents[1] / "docs"


@pytest.fixture(scope="module")
def page() -> str:
    """Return the page as the site shows it."""
    markdown = (DOCS / "reference" / "command-line.md").read_text()
    return hook("command_line").on_page_markdown(markdown)


def hook(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_all_options_of_a_command_are_listed(command: str, page: str) -> None:
    section = page.partition(f"\n## geovp {command}\n")[2].partition("\n## ")[0]
    parser = argparse.ArgumentParser()
    module = importlib.import_module(f"geovp_benchmarks.cli.{command}")
    add_groups(parser, module.ARGUMENTS)
    options = {name for name in parser._option_string_actions if name not in ("-h", "--help")}
    listed = re.findall(r"^\| <code>(.+?)</code>", section, re.MULTILINE)
    assert options <= {word.strip(",") for line in listed for word in line.split()}


def test_examples_are_accepted(page: str) -> None:
    examples = [line for line in page.splitlines() if re.match("geovp [a-z]", line)]
    assert len(examples) >= 2 * len(cli.COMMANDS)
    for example in examples:
        cli.command_line().parse_args(shlex.split(example)[1:])
