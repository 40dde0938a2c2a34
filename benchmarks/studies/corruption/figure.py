"""Curves of the corruption study: gain over copy-last by severity."""

from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from geovp_benchmarks.plots import style
from geovp_classic.types import FloatArray


def corruption_figure(
    gains_db: Mapping[str, Sequence[FloatArray]],  # [M] at each severity, by corruption
    methods: Sequence[str],  # "POSE_SOURCE RENDERER"
    num_columns: int = 5,
) -> Figure:
    """Draw a panel per corruption and a line per method; with one severity, lines are level."""
    num_rows = -(-len(gains_db) // num_columns)
    lines = style.line_styles([(name.split()[0], name.split()[1]) for name in methods])
    with mpl.style.context(style.SHEET):
        size_in = 1.5 * num_columns, 1.05 * num_rows
        figure = Figure(figsize=size_in, dpi=300, layout="constrained")
        panels = figure.subplots(num_rows, num_columns, sharex=True, sharey=True, squeeze=False)
        for axes in panels.flat[len(gains_db) :]:
            axes.set_visible(False)
        for axes, (name, gains) in zip(panels.flat, gains_db.items(), strict=False):
            axes.set_title(name, fontsize=6.5)
            axes.axhline(0, color="0.5", linewidth=0.8)
            levels = np.broadcast_to(gains, (4, len(methods)))
            for line, values, label in zip(lines, levels.T, methods, strict=True):
                axes.plot(range(1, 5), values, **line, linewidth=1.0, label=label)
        figure.supxlabel("severity", fontsize=7)
        figure.supylabel("dB over copying the last frame", fontsize=7)
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(methods), fontsize=7)
    return figure
