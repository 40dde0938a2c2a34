"""One figure: its file, size, titles and legend."""

import re
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.style import context

from geovp_classic.atomic import atomic_write

SHEET = Path(__file__).with_name("geovp.mplstyle")


@dataclass(frozen=True)
class Page:
    """One figure with its titles, ready to be written."""

    name: str  # of the file, from any characters
    subject: str = ""  # the metric or the clip
    title: str = ""
    subtitle: str = ""
    formats: tuple[str, ...] = ("png", "svg")
    figure: Figure = field(default_factory=lambda: Figure(dpi=200, layout="constrained"))

    @property
    def stem(self) -> str:
        """Return the name of the file without its ending."""
        return re.sub("[^a-z0-9]+", "-", self.name.lower())

    def add_axes(self, width_in: float, height_in: float, num_rows: int = 1) -> list[Axes]:
        """Add axes to a figure of this size."""
        self.figure.set_size_inches(width_in, height_in)
        return list(self.figure.subplots(num_rows, squeeze=False)[:, 0])

    @context(SHEET)
    def add_titles(self) -> None:
        """Add the titles, which figures in a paper do not have."""
        num_letters = int(15 * self.figure.get_figwidth())
        lines = [textwrap.fill(line, num_letters) for line in (self.title, self.subtitle)]
        self.figure.suptitle("\n".join(lines), x=0.01, ha="left")

    def add_legend(self, lines: Mapping[str, Artist]) -> None:
        """Place a legend of lines by label below the axes, and make the figure higher by it.

        It has as many columns as fit; many lines have a small font.
        """
        width_in, height_in = self.figure.get_size_inches()
        labels = [textwrap.fill(label, int(14 * width_in)) for label in lines]
        for num_columns in (4, 3, 2, 1):
            legend = self.figure.legend(
                lines.values(),
                labels,
                loc="outside lower left",
                ncols=num_columns,
                fontsize=6 if len(lines) > 6 else None,
                handlelength=1.8,
                columnspacing=1,
            )
            if num_columns == 1 or legend.get_window_extent().width <= self.figure.bbox.width:
                break
            legend.remove()
        added_in = legend.get_window_extent().height / self.figure.dpi
        self.figure.set_size_inches(width_in, height_in + added_in)

    @context(SHEET)
    def write(self, path: Path) -> None:
        """Write the figure as png, jpg, svg or pdf."""
        with atomic_write(path) as scratch:
            self.figure.savefig(scratch, format=path.suffix[1:])
