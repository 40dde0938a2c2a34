"""Look of the studies' figures."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geovp.drawing import page


@contextmanager
def panels(path: Path, size_in: tuple[float, float], num_columns: int) -> Iterator[Sequence[Axes]]:
    """Yield panels with a shared y axis; then write them with a legend above to a file."""
    with mpl.style.context(page.SHEET):
        figure = Figure(figsize=size_in, dpi=300, layout="constrained")
        (row,) = figure.subplots(1, num_columns, sharey=True, squeeze=False)
        yield list(row)
        lines, labels = row[0].get_legend_handles_labels()
        figure.legend(lines, labels, loc="outside upper center", ncols=len(lines))
        figure.savefig(path)
