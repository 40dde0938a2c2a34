"""How figures are to be used: file formats, the width that they have on the page, with or without
titles.
"""

import re
import textwrap
from dataclasses import dataclass

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text
from matplotlib.transforms import ScaledTranslation

from geovp_benchmarks.plots import style
from geovp_classic.errors import BadData

UNITS_IN = {"in": 1.0, "cm": 1 / 2.54, "mm": 1 / 25.4, "pt": 1 / 72.27, "": 1.0}
LEAST_IN, WIDE_IN = 2.5, 5.5  # a legend stands beside the axes from WIDE_IN on, else below them
BELOW_PT = 40  # room for the labels of the x axis above the legend
LEAST_HEIGHT_IN = 2.1  # of curves, for the words beside the y axis
LETTERS_AN_INCH, BESIDE_IN = 16, 0.7  # of a subtitle; what stands left of the axes
TILE_IN = 0.8  # an image of a film strip is at least so wide


@dataclass(frozen=True)
class Layout:
    """Fonts keep their size in points, whatever the width."""

    formats: tuple[str, ...] = ()  # none: each figure's own
    width_in: float | None = None  # of the file; None: as the figure comes
    with_title: bool = True

    @property
    def most_tiles(self) -> int | None:
        """How many images of a film strip stand side by side at most."""
        return None if self.width_in is None else max(2, int(self.width_in / TILE_IN))

    def apply(self, figure: Figure) -> None:
        """Change a drawn figure; to be called, as drawing is, with the style sheet in force."""
        (axes,) = figure.axes
        if not self.with_title:
            axes.set_title("", loc="left")
            for words in figure.findobj(lambda artist: artist.get_gid() == style.TITLE):
                words.remove()
        if self.width_in is None:
            return
        _wrap_title(figure, self.width_in)
        legend = axes.get_legend()
        if legend is not None and self.width_in < WIDE_IN:
            below = axes.transAxes + ScaledTranslation(0, -BELOW_PT / 72, figure.dpi_scale_trans)
            legend.set_loc("upper left")
            legend.set_bbox_to_anchor((0, 0), transform=below)
        is_to_scale = bool(axes.images) or axes.get_aspect() != "auto"
        least_in = 0.0 if is_to_scale else min(LEAST_HEIGHT_IN, float(figure.get_figheight()))
        for _ in range(
            3
        ):  # labels keep their size while the axes shrink; how ticks are labelled may change
            _fit(figure, self.width_in, least_in)


def width_in(text: str) -> float:
    """Inches of "3.3in", "8.4cm", "84mm" or "240pt"; BadData for anything else, and for less than
    LEAST_IN.
    """
    found = re.fullmatch(r"([0-9.]+)\s*([a-z]*)", text)
    if not found or found[2] not in UNITS_IN or found[1].count(".") > 1 or found[1] == ".":
        raise BadData(f"--width {text!r} is not a length: give one such as 3.3in, 84mm or 240pt")
    inches = float(found[1]) * UNITS_IN[found[2]]
    if inches < LEAST_IN:
        raise BadData(
            f"--width {text} leaves no room for labels that can be read: give {LEAST_IN}in or more"
        )
    return inches


def _wrap_title(figure: Figure, width: float) -> None:
    """Break the subtitle's line, and raise the title by the lines that are more."""
    (subtitle,) = [
        words
        for words in figure.findobj(Text)
        if words.get_text() == figure.axes[0].get_title("left")
    ][:1]
    subtitle.set_text(
        textwrap.fill(subtitle.get_text(), int((width - BESIDE_IN) * LETTERS_AN_INCH))
    )
    for words in figure.findobj(lambda artist: artist.get_gid() == style.TITLE):
        assert isinstance(words, Annotation)
        left, up = words.xyann
        words.xyann = (left, up + 9 * subtitle.get_text().count("\n"))


def _fit(figure: Figure, width: float, least_height_in: float) -> None:
    """Shrink or widen the axes by what the file would be too wide or too narrow."""
    box = figure.get_tightbbox(FigureCanvasAgg(figure).get_renderer())
    before, height = figure.get_size_inches()
    now = max(before - (box.width + 2 * mpl.rcParams["savefig.pad_inches"] - width), 1.0)
    figure.set_size_inches(now, max(height * now / before, least_height_in))
