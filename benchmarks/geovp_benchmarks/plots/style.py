"""Look of figures: their content and size; colours for the colour-blind, dashes, markers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Options:
    """Content, format and size of figures; fonts keep their size in points."""

    metrics: Sequence[str] = ()  # empty: all
    by: str | None = None  # strata
    against: str | None = None  # method that the others are compared with
    format: str | None = None  # None: the formats of each figure
    width_in: float | None = None  # in a paper, without titles; None: as each kind of figure has it
    max_methods: int = 6  # unless methods are selected
    max_intervals: int = 6  # with more lines, no intervals are drawn: they would cover the lines


def line_styles(keys: Sequence[tuple[str, str]]) -> list[dict[str, Any]]:
    """Return arguments of `Axes.plot` per pair such as (pose source, renderer).

    Colour encodes the first name, dash and marker the second; both encode the first where there is
    a single second name.
    """
    dashes = ("-", (0, (5, 1.6)), (0, (1, 1.3)), (0, (6, 1.5, 1, 1.5)))
    firsts, seconds = (list(dict.fromkeys(key[place] for key in keys)) for place in (0, 1))
    styles = []
    for first, second in keys:
        colour = firsts.index(first)
        form = seconds.index(second) + (colour if len(seconds) == 1 else colour // 9)
        styles.append(
            {
                "color": f"C{colour}",
                "linestyle": dashes[form % 4],
                "marker": "os^DvPX"[form % 7],
            }
        )
    return styles
