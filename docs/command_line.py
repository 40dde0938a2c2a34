"""Reference of the command line, generated from its argument parsers."""

import argparse
import html
import re
from collections.abc import Iterator
from typing import Any

from geovp_benchmarks.cli import command_line

PLACE = "<!-- generated: commands -->"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill in the commands; mkdocs calls this for every page."""
    return markdown.replace(PLACE, commands()) if PLACE in markdown else markdown


def commands() -> str:
    """Return one section per command: description, tables of options, and examples."""
    (choices,) = (
        action.choices
        for action in command_line()._actions
        if isinstance(action, argparse._SubParsersAction)
    )
    return "\n\n".join("\n\n".join(section(parser)) for parser in choices.values())


def section(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield the paragraphs and tables of a command."""
    yield f"## {parser.prog}"
    yield prose(parser.description).strip()
    for group in parser._action_groups:
        actions = [action for action in group._group_actions if action.dest != "help"]
        if actions:
            title = (group.title or "").capitalize()
            rows = [f"| {spelling(each)} | {prose(each.help)} |" for each in actions]
            yield "\n".join([f"| {title} | |", "| --- | --- |", *rows])
    examples = (parser.epilog or "").partition("\n")[2]
    lines = [line.strip() for line in examples.splitlines() if line.strip()]
    yield "\n".join(["```sh", *lines, "```"])


def spelling(action: argparse.Action) -> str:
    """Return the names of an option with its values, or a positional argument, as HTML code."""
    formatter = argparse.HelpFormatter("geovp")
    names = ", ".join(action.option_strings)
    values = formatter._format_args(action, str(action.metavar or action.dest).upper())
    if not names:
        values = str(action.metavar or action.dest)
    elif action.nargs == 0:
        values = ""
    code = html.escape(f"{names} {values}".strip(), quote=False).replace("|", "&#124;")
    return f"<code>{code}</code>"


def prose(text: str | None) -> str:
    """Return help as Markdown: percent signs, HTML and table bars are literal."""
    plain = html.escape((text or "").replace("%%", "%"), quote=False).replace("|", r"\|")
    return re.sub(r"(?<!`)(--[a-z][a-z-]*)", r"`\1`", plain)
