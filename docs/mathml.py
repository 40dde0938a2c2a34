"""Equations of the pages as MathML, which browsers draw without a script or a network."""

import html
import re
from typing import Any

from latex2mathml.converter import convert

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    """Convert all formulas of a page; mkdocs calls this for each page."""
    return FORMULA.sub(_mathml, content)


def _mathml(match: re.Match[str]) -> str:
    kind = "block" if match[1] == "div" else "inline"
    return f"<{match[1]}>{convert(html.unescape(match[2]), display=kind)}</{match[1]}>"
