"""HTML elements that escape plain strings, and the style sheet of the report."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable

MEDIA = {"svg": "image/svg+xml", "jpg": "image/jpeg", "png": "image/png"}
WITHOUT_END = ("img", "meta")
STYLE = """
body { margin: 0 auto; padding: 1.5rem; max-width: 84rem; color: #1d2129; font: 15px/1.5 system-ui, sans-serif; }
h1, h3, dd, td:first-child, summary { overflow-wrap: anywhere; }
h2 { margin-top: 2.5rem; border-bottom: 1px solid #dfe3e8; }
nav a { margin-right: 1rem; }
.wide, pre { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; }
th, td { padding: .35rem .7rem; text-align: right; border-bottom: 1px solid #dfe3e8; }
th:first-child, td:first-child, .words { text-align: left; }
td { white-space: nowrap; }
td:first-child, td.words { white-space: normal; min-width: 12rem; }
.error, sup, .notes { color: #5b6472; font-size: .85rem; }
.done { color: #00734f; } .partial, .skipped { color: #9a5b00; } .failed { color: #b42318; }
.pairs { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 32rem), 1fr)); gap: 1rem; }
figure { margin: 0 0 1rem; }
img { max-width: 100%; height: auto; }
@media print { .wide { overflow: visible; } table { font-size: 8pt; } }
"""


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
        tag("style", Html(STYLE)),
    )
    return Html("<!doctype html>\n" + tag("html", head, tag("body", *content), lang="en") + "\n")


def _line(name: str, cells: Iterable[str]) -> Html:
    return tag("tr", *(text if isinstance(text, Html) else tag(name, text) for text in cells))
