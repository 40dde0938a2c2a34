"""How every figure looks: colours that the colour-blind tell apart, dashes that survive grey print, small type."""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

PRINT_DPI = 300
TITLE_PT, SUBTITLE_PT = 9.5, 7.5
INK = "#222222"
FAINT = "#8a8a8a"
RULE = "#d9d9d9"
TRUTH = "#000000"
COLOURS = (  # Okabe and Ito 2008 without yellow and black, then Tol's indigo, wine and olive
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#56b4e9",
    "#e69f00",
    "#332288",
    "#882255",
    "#7a7a00",
)
DASHES: tuple[tuple[float, tuple[float, ...] | None], ...] = (
    (0, None),
    (0, (5, 1.6)),
    (0, (1, 1.3)),
    (0, (6, 1.5, 1, 1.5)),
)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
SETTINGS: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8,
    "svg.fonttype": "none",  # text stays text: searchable, editable, small
    "svg.hashsalt": "geovp",  # the same figure gives the same bytes
    "text.parse_math": False,  # a $ in a name is a $
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


@dataclass(frozen=True)
class Stroke:
    """How one line is drawn."""

    colour: str
    dash: tuple[float, tuple[float, ...] | None]
    marker: str

    def line(self, width: float = 1.4) -> dict[str, Any]:
        """The keyword arguments of `Axes.plot` for it."""
        marker = {"marker": self.marker, "markersize": 4, "markeredgecolor": "white", "markeredgewidth": 0.5}
        return {"color": self.colour, "linestyle": self.dash, "linewidth": width, **marker}


TRUTH_STROKE = Stroke(TRUTH, DASHES[0], MARKERS[0])


def strokes(keys: Sequence[tuple[str, str]]) -> list[Stroke]:
    """One stroke per (part, other part) such as (pose source, renderer); no two alike up to 252 of them.

    Where several lines share a part, colour says the first part, dash and marker say the second; otherwise all three
    change from line to line.
    """
    firsts, seconds = _ranks(first for first, _ in keys), _ranks(second for _, second in keys)
    crossed = len(firsts) < len(keys) and len(firsts) <= len(COLOURS) and len(seconds) <= len(DASHES) * len(MARKERS)
    pairs = [(firsts[a], seconds[b]) if crossed else (i, i) for i, (a, b) in enumerate(keys)]
    return [
        Stroke(COLOURS[hue % len(COLOURS)], DASHES[form % len(DASHES)], MARKERS[form % len(MARKERS)])
        for hue, form in pairs
    ]


def settings() -> AbstractContextManager[None]:
    """The settings of all figures, for use with `with`; nothing global is left behind."""
    context: AbstractContextManager[None] = matplotlib.rc_context(SETTINGS)
    return context


@dataclass(frozen=True)
class Margins:
    """Room around the axes, in inches."""

    left_in: float = 0.62
    right_in: float = 0.15
    top_in: float = 0.52
    bottom_in: float = 0.58


@dataclass(frozen=True)
class Words:
    """What stands above the axes."""

    title: str
    subtitle: str

    @property
    def width_in(self) -> float:
        """How wide they are; bold letters are an eighth wider."""
        return max(1.125 * width_in([self.title], TITLE_PT), width_in([self.subtitle], SUBTITLE_PT))

    def numbered(self, page: int, pages: int) -> Words:
        """The same with the page's number, where there are several."""
        return Words(f"{self.title} ({page} of {pages})", self.subtitle) if pages > 1 else self


def sheet(size_in: tuple[float, float], margins: Margins, words: Words, dpi: float = PRINT_DPI) -> tuple[Figure, Axes]:
    """A figure with axes of the given size that leaves the margins, more where the words need it."""
    right_in = max(margins.right_in, words.width_in - size_in[0] + 0.1)
    wide_in = margins.left_in + size_in[0] + right_in
    high_in = margins.bottom_in + size_in[1] + margins.top_in
    figure = Figure(figsize=(wide_in, high_in), dpi=dpi)
    left, bottom = margins.left_in / wide_in, margins.bottom_in / high_in
    axes = figure.add_axes((left, bottom, size_in[0] / wide_in, size_in[1] / high_in))
    lift_pt = margins.top_in * 72 - TITLE_PT - 21
    above: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
    axes.annotate(words.title, (0, 1), (0, lift_pt + 12), **above, fontsize=TITLE_PT, weight="bold", color=INK)
    axes.annotate(words.subtitle, (0, 1), (0, lift_pt), **above, fontsize=SUBTITLE_PT, color=FAINT)
    return figure, axes


def width_in(texts: Iterable[str], size_pt: float) -> float:
    """The width of the longest text."""
    return max((_width_in(text, size_pt) for text in texts if text.strip()), default=0.0)


@functools.lru_cache(maxsize=1000)  # the same names stand on every figure
def _width_in(text: str, size_pt: float) -> float:
    outline = TextPath((0, 0), text, prop=FontProperties(family="DejaVu Sans", size=size_pt))
    return float(outline.vertices[:, 0].max()) / 72


def tidy(axes: Axes) -> None:
    """Thin rules, no box, light ticks."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(FAINT)
        axes.spines[side].set_linewidth(0.6)
    axes.tick_params(colors=INK, length=3, width=0.6, labelsize=7.5)
    axes.grid(True, color=RULE, linewidth=0.5)
    axes.set_axisbelow(True)


def wrapped(text: str, width: int) -> str:
    """The text in lines of at most `width` characters, broken at spaces and after + / - _ where possible."""
    lines = [""]
    for piece in re.findall(r"[^\s+/_-]*[\s+/_-]|[^\s+/_-]+", text):
        for part in (piece[i : i + width] for i in range(0, len(piece), width)):
            if lines[-1].strip() and len((lines[-1] + part).rstrip()) > width:
                lines.append("")
            lines[-1] += part
    return "\n".join(line.strip() for line in lines)


def spread(desired: Sequence[float], gap: float, low: float, high: float) -> list[float]:
    """Positions nearest to the desired ones that are at least `gap` apart and, while there is room, in [low, high]."""
    order = sorted(range(len(desired)), key=lambda i: desired[i])
    blocks: list[tuple[float, int]] = []  # (sum of desired first positions, members): pool adjacent violators
    for rank, i in enumerate(order):
        blocks.append((desired[i] - rank * gap, 1))
        while len(blocks) > 1 and blocks[-2][0] / blocks[-2][1] > blocks[-1][0] / blocks[-1][1]:
            (total, count), (more, others) = blocks[-2:]
            blocks[-2:] = [(total + more, count + others)]
    placed = [0.0] * len(desired)
    firsts = [total / count for total, count in blocks for _ in range(count)]
    highest = max(low, high - gap * (len(desired) - 1))
    for rank, (i, first) in enumerate(zip(order, firsts, strict=True)):
        placed[i] = min(max(first, low), highest) + rank * gap
    return placed


def pages(count: int, most: int) -> list[range]:
    """Index ranges that share `count` rows evenly over as few pages of at most `most` rows as needed."""
    number = max(1, -(-count // most))
    edges = [round(i * count / number) for i in range(number + 1)]
    return [range(a, b) for a, b in itertools.pairwise(edges)]


def _ranks(words: Iterable[str]) -> dict[str, int]:
    return {word: rank for rank, word in enumerate(dict.fromkeys(words))}
