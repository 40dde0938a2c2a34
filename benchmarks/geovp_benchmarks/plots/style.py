"""The look of figures: colours for the colour-blind, dashes and markers that survive grey print."""

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

SHEET = Path(__file__).with_name("geovp.mplstyle")
PRINT_DPI = 300
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
MARKERS = "os^DvPX"


@dataclass(frozen=True)
class LineStyle:
    """Colour, dash pattern and marker of one line."""

    colour: str
    dash: Dash
    marker: str

    def kwargs(self, width: float = 1.4) -> dict[str, Any]:
        """Return the keyword arguments of `Axes.plot`."""
        marker = {"marker": self.marker, "markersize": 4, "markeredgecolor": "white"}
        return {"color": self.colour, "linestyle": self.dash, "linewidth": width, **marker}


GROUND_TRUTH = LineStyle("#000000", DASHES[0], MARKERS[0])


def line_styles(keys: Sequence[tuple[str, str]]) -> list[LineStyle]:
    """Return one style per pair such as (pose source, renderer); up to 252 of them differ.

    Where pairs have first names in common, colour encodes the first name, dash and marker the
    second; otherwise all three change from line to line.
    """
    firsts, seconds = _ranks(first for first, _ in keys), _ranks(second for _, second in keys)
    has_common_names = len(firsts) < len(keys)
    has_enough = len(firsts) <= len(COLOURS) and len(seconds) <= len(DASHES) * len(MARKERS)
    styles = []
    for number, (first, second) in enumerate(keys):
        colour, form = number, number
        if has_common_names and has_enough:
            colour, form = firsts[first], seconds[second]
        styles.append(
            LineStyle(
                COLOURS[colour % len(COLOURS)],
                DASHES[form % len(DASHES)],
                MARKERS[form % len(MARKERS)],
            )
        )
    return styles


@dataclass(frozen=True)
class Heading:
    """Title and subtitle above the axes."""

    title: str
    subtitle: str


@dataclass(frozen=True)
class Layout:
    """File formats and the size of figures; fonts keep their size in points."""

    formats: tuple[str, ...] = ()  # empty: the formats of each figure
    width_in: float | None = None  # of the file; None: the width of each kind of figure
    with_title: bool = True
    max_lines: int = 12  # more cannot be told apart
    max_intervals: int = 6  # with more lines, no intervals are drawn: they would cover the lines
    letters_per_in: float = 20.0  # of the sans-serif font at 7.5 points

    def single_axes(self, default_in: tuple[float, float], heading: Heading) -> tuple[Figure, Axes]:
        """Create a figure with its titles, which keeps all text inside its edges."""
        width_in = self.width_in or default_in[0]
        figure = Figure((width_in, default_in[1]), dpi=PRINT_DPI, layout="constrained")
        axes = figure.add_subplot()
        if self.with_title:
            figure.suptitle(self._wrapped(heading.title, width_in, 0.6), x=0.01, ha="left")
            subtitle = self._wrapped(heading.subtitle, width_in)
            axes.set_title(subtitle, loc="left", color=FAINT)
        return figure, axes

    def add_legend(self, figure: Figure, lines: Sequence[Artist], labels: Sequence[str]) -> None:
        """Place a legend below the axes and make the figure higher by the size of the legend."""
        width_in, height_in = figure.get_size_inches()
        handle_in = 0.6
        longest_in = handle_in + max(map(len, labels), default=0) / self.letters_per_in
        num_columns = max(1, int(width_in / longest_in))
        names = [self._wrapped(label, width_in - handle_in, 1.0) for label in labels]
        figure.legend(lines, names, loc="outside lower left", ncols=num_columns)
        num_lines = sum(name.count("\n") + 1 for name in names) / num_columns + 1
        figure.set_size_inches(width_in, height_in + 0.155 * num_lines)

    def _wrapped(self, text: str, width_in: float, scale: float = 0.8) -> str:
        return textwrap.fill(text, max(8, int(width_in * self.letters_per_in * scale)))


def _ranks(words: Iterable[str]) -> dict[str, int]:
    return {word: rank for rank, word in enumerate(dict.fromkeys(words))}
