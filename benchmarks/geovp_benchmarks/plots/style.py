"""The look of all figures: colours for the colour-blind, dashes and markers that survive grey
print.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

PRINT_DPI = 300
TITLE = "title"  # what the heading above the axes is marked with
INK = "#222222"
FAINT = "#8a8a8a"
RULE = "#d9d9d9"
# Okabe and Ito 2008 without yellow and black, then Tol's indigo, wine and olive
COLOURS = (
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
Dash = tuple[float, tuple[float, ...] | None]
DASHES: tuple[Dash, ...] = ((0, None), (0, (5, 1.6)), (0, (1, 1.3)), (0, (6, 1.5, 1, 1.5)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
SHEET = Path(__file__).with_name("geovp.mplstyle")


@dataclass(frozen=True)
class LineStyle:
    """Colour, dash pattern and marker of one line."""

    colour: str
    dash: Dash
    marker: str

    def kwargs(self, width: float = 1.4) -> dict[str, Any]:
        """The keyword arguments of `Axes.plot`."""
        marker = {
            "marker": self.marker,
            "markersize": 4,
            "markeredgecolor": "white",
            "markeredgewidth": 0.5,
        }
        return {"color": self.colour, "linestyle": self.dash, "linewidth": width, **marker}


GROUND_TRUTH = LineStyle("#000000", DASHES[0], MARKERS[0])


def line_styles(keys: Sequence[tuple[str, str]]) -> list[LineStyle]:
    """One style per pair such as (pose source, renderer); all differ for up to 252 of them.

    Where pairs share their first part, colour encodes the first part, dash and marker the second;
    otherwise all three change from line to line.
    """
    firsts, seconds = _ranks(first for first, _ in keys), _ranks(second for _, second in keys)
    crossed = (
        len(firsts) < len(keys)
        and len(firsts) <= len(COLOURS)
        and len(seconds) <= len(DASHES) * len(MARKERS)
    )
    pairs = [(firsts[a], seconds[b]) if crossed else (i, i) for i, (a, b) in enumerate(keys)]
    return [
        LineStyle(
            COLOURS[hue % len(COLOURS)], DASHES[form % len(DASHES)], MARKERS[form % len(MARKERS)]
        )
        for hue, form in pairs
    ]


@dataclass(frozen=True)
class Heading:
    """Title and subtitle above the axes."""

    title: str
    subtitle: str


def single_axes(
    size_in: tuple[float, float], heading: Heading, dpi: float = PRINT_DPI, pad_pt: float = 6
) -> tuple[Figure, Axes]:
    """A figure with axes of the given size; titles are added above it, and labels and a legend may
    be around it.
    """
    figure = Figure(figsize=size_in, dpi=dpi)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_title(heading.subtitle, loc="left", fontsize=7.5, color=FAINT, pad=pad_pt)
    title_pt: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
    axes.annotate(
        heading.title,
        (0, 1),
        (0, pad_pt + 12),
        **title_pt,
        fontsize=9.5,
        weight="bold",
        color=INK,
        gid=TITLE,
    )
    return figure, axes


def pages(count: int, most: int, heading: Heading) -> list[tuple[slice, Heading]]:
    """As few pages of at most `most` rows as needed, which share `count` rows evenly, with the
    pages' headings.
    """
    number = max(1, -(-count // most))
    edges = [round(i * count / number) for i in range(number + 1)]
    titles = [
        f"{heading.title} ({n} of {number})" if number > 1 else heading.title
        for n in range(1, number + 1)
    ]
    rows = itertools.pairwise(edges)
    return [
        (slice(*ends), Heading(title, heading.subtitle))
        for ends, title in zip(rows, titles, strict=True)
    ]


def _ranks(words: Iterable[str]) -> dict[str, int]:
    return {word: rank for rank, word in enumerate(dict.fromkeys(words))}
