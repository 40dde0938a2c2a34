"""HTML elements that escape plain strings, and the page of the report."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable
from pathlib import Path

MEDIA = {"svg": "image/svg+xml", "jpg": "image/jpeg", "png": "image/png"}
WITHOUT_END = ("img", "meta")
STYLE = Path(__file__).with_name("report.css")


class Html(str):
    """Text that is HTML already; `tag` escapes any other string."""

    __slots__ = ()


def tag(name: str, /, *content: str, **attributes: str) -> Html:
    """An element; attributes that Python reserves take a trailing underscore: class_."""
    listed = "".join(f' {key.rstrip("_")}="{html.escape(value)}"' for key, value in attributes.items())
    return Html(f"<{name}{listed}>" if name in WITHOUT_END else f"<{name}{listed}>{joined(content)}</{name}>")


def joined(parts: Iterable[str]) -> Html:
    """The parts concatenated, escaped unless they are Html."""
    return Html("".join(part if isinstance(part, Html) else html.escape(part) for part in parts))


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Html:
    """A table that scrolls horizontally where it is too wide; a cell that is Html is a whole th or td element."""
    lines = (_line("td", row) for row in rows)
    return tag("div", tag("table", tag("thead", _line("th", head)), tag("tbody", *lines)), class_="wide")


def image(content: bytes, kind: str, description: str) -> Html:
    """An image embedded in the page."""
    data = base64.b64encode(content).decode()
    return tag("figure", tag("img", src=f"data:{MEDIA[kind]};base64,{data}", alt=description, title=description))


def fold(summary: str, *content: str) -> Html:
    """A <details> element that opens on a click; nothing without content."""
    return tag("details", tag("summary", summary), *content) if content else Html("")


def page(title: str, *content: str) -> Html:
    """The whole document, without external resources."""
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Html(STYLE.read_text(encoding="utf-8"))),
    )
    return Html("<!doctype html>\n" + tag("html", head, tag("body", *content), lang="en") + "\n")


def _line(name: str, cells: Iterable[str]) -> Html:
    return tag("tr", *(text if isinstance(text, Html) else tag(name, text) for text in cells))
