"""HTML that is escaped unless it was made here, and the look of the report's page."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable

MEDIA = {"svg": "image/svg+xml", "jpg": "image/jpeg", "png": "image/png"}
WITHOUT_END = ("img", "meta", "br")
STYLE = """
:root { --ink: #1d2129; --faint: #667085; --rule: #dfe3e8; --page: #ffffff; --raised: #f6f7f9; --accent: #0072b2;
  --good: #00734f; --warn: #9a5b00; --bad: #b42318; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e7ec; --faint: #98a2b3; --rule: #344054; --page: #12161c;
  --raised: #1b212a; --accent: #56b4e9; --good: #4ade9b; --warn: #f5b94c; --bad: #ff8a7a; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2.5rem 1.5rem 4rem; max-width: 84rem; background: var(--page); color: var(--ink);
  font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
h1 { font-size: 1.8rem; line-height: 1.2; margin: 0 0 .3rem; overflow-wrap: anywhere; }
h2 { font-size: 1.2rem; margin: 2.8rem 0 .8rem; padding-bottom: .3rem; border-bottom: 1px solid var(--rule); }
h3 { font-size: 1rem; margin: 1.6rem 0 .5rem; overflow-wrap: anywhere; }
p.lead { color: var(--faint); margin: 0; }
nav { margin-top: 1rem; display: flex; flex-wrap: wrap; gap: .3rem 1.2rem; }
a { color: var(--accent); text-decoration: none; }
a:hover { text-decoration: underline; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: .9rem; }
th, td { padding: .35rem .7rem; text-align: right; border-bottom: 1px solid var(--rule); white-space: nowrap; }
th { font-weight: 600; color: var(--faint); border-bottom-color: var(--faint); vertical-align: bottom;
  white-space: normal; }
th:first-child, td:first-child, .words { text-align: left; }
td:first-child, td.words { white-space: normal; min-width: 16rem; overflow-wrap: anywhere; }
sup { line-height: 0; }
tbody tr:hover { background: var(--raised); }
td b { color: var(--accent); }
.error, sup, .unit { color: var(--faint); }
.error { font-size: .85em; }
ul.notes { color: var(--faint); font-size: .85rem; margin: .8rem 0 0; padding-left: 1.1rem; }
.done { color: var(--good); } .partial, .skipped { color: var(--warn); } .failed { color: var(--bad); }
.pairs { display: grid; grid-template-columns: repeat(auto-fill, minmax(32rem, 1fr)); gap: 1rem; margin-bottom: 1rem; }
figure { margin: 0 0 1.2rem; background: #ffffff; border: 1px solid var(--rule); border-radius: 6px; padding: .6rem;
  break-inside: avoid; }
.pairs figure { margin: 0; }
figure img { display: block; max-width: 100%; height: auto; margin: 0 auto; }
details { margin: .4rem 0; border: 1px solid var(--rule); border-radius: 6px; padding: .4rem .8rem; }
details[open] > summary { margin-bottom: .6rem; }
summary { cursor: pointer; overflow-wrap: anywhere; }
pre { margin: .4rem 0; padding: .7rem .9rem; background: var(--raised); border-radius: 6px; overflow-x: auto;
  font: 12.5px/1.45 ui-monospace, "DejaVu Sans Mono", monospace; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .25rem 1.4rem; margin: 0; font-size: .92rem; }
dt { color: var(--faint); } dd { margin: 0; overflow-wrap: anywhere; }
@media (max-width: 40rem) { .pairs { grid-template-columns: 1fr; } }
@media print { :root { --ink: #000; --faint: #444; --rule: #bbb; --page: #fff; --raised: #f4f4f4; --accent: #000; }
  body { max-width: none; padding: 0; font-size: 10pt; } nav { display: none; } .wide { overflow: visible; }
  .pairs { grid-template-columns: 1fr 1fr; } h2, h3 { break-after: avoid; } table { font-size: 8pt; }
  th, td { padding: .2rem .35rem; } figure { border: 0; padding: 0; } }
"""


class Html(str):
    """Text that is HTML already; any other string is escaped when it is put into a tag."""

    __slots__ = ()


def tag(name: str, /, *inside: str, **attributes: str) -> Html:
    """An element; attributes that Python reserves take a trailing underscore: class_."""
    words = "".join(f' {key.rstrip("_")}="{html.escape(value)}"' for key, value in attributes.items())
    return Html(f"<{name}{words}>" if name in WITHOUT_END else f"<{name}{words}>{joined(inside)}</{name}>")


def joined(parts: Iterable[str]) -> Html:
    """Parts one after the other, escaped where they are not HTML yet."""
    return Html("".join(part if isinstance(part, Html) else html.escape(part) for part in parts))


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Html:
    """A table that scrolls sideways where it is too wide; a cell that is HTML already is a whole th or td."""
    lines = (_line("td", row) for row in rows)
    return tag("div", tag("table", tag("thead", _line("th", head)), tag("tbody", *lines)), class_="wide")


def image(content: bytes, kind: str, description: str) -> Html:
    """An image inside the page itself."""
    data = base64.b64encode(content).decode()
    return tag("figure", tag("img", src=f"data:{MEDIA[kind]};base64,{data}", alt=description, title=description))


def fold(summary: str, *inside: str) -> Html:
    """Something that opens on a click."""
    return tag("details", tag("summary", summary), *inside) if inside else Html("")


def definitions(pairs: Iterable[tuple[str, str]]) -> Html:
    """Terms and what they are."""
    return tag("dl", *(joined((tag("dt", term), tag("dd", meaning))) for term, meaning in pairs))


def page(title: str, *inside: str) -> Html:
    """The whole document; nothing in it is fetched from anywhere."""
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Html(STYLE)),
    )
    return Html("<!doctype html>\n" + tag("html", head, tag("body", *inside), lang="en") + "\n")


def _line(name: str, cells: Iterable[str]) -> Html:
    return tag("tr", *(text if isinstance(text, Html) else tag(name, text) for text in cells))
