"""HTML elements that escape plain strings, and the page of the report."""

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

MEDIA = {"svg": "image/svg+xml", "webp": "image/webp", "png": "image/png"}
WITHOUT_END = ("img", "meta", "input")
STYLE, SCRIPT = (Path(__file__).with_name(f"report.{ending}") for ending in ("css", "js"))


class Html(str):
    """Text that is HTML already; `tag` escapes any other string."""

    __slots__ = ()


def tag(name: str, /, *content: str, **attributes: str) -> Html:
    """An element; attributes that Python reserves take a trailing underscore: class_; data_x is
    data-x.
    """
    listed = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html.escape(value)}"'
        for key, value in attributes.items()
    )
    return Html(
        f"<{name}{listed}>"
        if name in WITHOUT_END
        else f"<{name}{listed}>{joined(content)}</{name}>"
    )


def joined(parts: Iterable[str]) -> Html:
    """The parts concatenated, escaped unless they are Html."""
    return Html("".join(part if isinstance(part, Html) else html.escape(part) for part in parts))


def table(head: Iterable[str], rows: Iterable[Iterable[str]], names: Sequence[str] = ()) -> Html:
    """A table that scrolls in a box of its own; a cell that is Html is a whole th or td element.

    With the rows' names it can be sorted, and its rows found by them.
    """
    if names:
        lines = [_line("td", row, data_row=name) for row, name in zip(rows, names, strict=True)]
    else:
        lines = [_line("td", row) for row in rows]
    kind = {"class_": "sortable"} if names else {}
    return tag(
        "div",
        tag("table", tag("thead", _line("th", head)), tag("tbody", *lines), **kind),
        class_="full",
    )


def image(content: bytes, kind: str, description: str) -> Html:
    """An image embedded in the page."""
    return tag(
        "figure", tag("img", src=data_url(content, kind), alt=description, title=description)
    )


def data_url(content: bytes, kind: str) -> str:
    """A file inside the page."""
    return f"data:{MEDIA[kind]};base64,{base64.b64encode(content).decode()}"


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
    body = tag("body", *content, tag("script", Html(SCRIPT.read_text(encoding="utf-8"))))
    return Html("<!doctype html>\n" + tag("html", head, body, lang="en") + "\n")


def _line(name: str, cells: Iterable[str], **attributes: str) -> Html:
    return tag(
        "tr", *(text if isinstance(text, Html) else tag(name, text) for text in cells), **attributes
    )
