"""Curves of the study of corruptions: gain over copy-last by severity."""

from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from geovp_benchmarks.plots import style
from geovp_classic.types import FloatArray

NUM_COLUMNS = 5
PANEL_IN = (1.5, 1.05)


def corruption_figure(
    gains_db: Mapping[
        str, FloatArray
    ],  # [severities, methods] of each corruption, in dB over copying the last frame
    methods: Sequence[tuple[str, str]],  # pose source and renderer of each method
    limit_db: float,  # that no method should be further below copying
) -> Figure:
    """Draw a panel per corruption and a line per method; with one severity, lines are level."""
    rows = -(-len(gains_db) // NUM_COLUMNS)
    size_in = PANEL_IN[0] * NUM_COLUMNS, PANEL_IN[1] * rows
    with mpl.style.context(style.SHEET):
        figure = Figure(figsize=size_in, dpi=style.PRINT_DPI, layout="constrained")
        panels = figure.subplots(rows, NUM_COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
        for axes, (name, gains) in zip(panels, gains_db.items(), strict=False):
            axes.axhline(-limit_db, color=style.FAINT, linewidth=0.8)
            axes.set_title(name, fontsize=6.5)
            severities = np.arange(1, 1 + max(len(gains), 4))
            for values, line, method in zip(
                gains.T, style.line_styles(methods), methods, strict=True
            ):
                shown = np.broadcast_to(values, severities.shape) if len(values) == 1 else values
                axes.plot(
                    severities,
                    shown,
                    **(line.kwargs(1.0) | {"markersize": 2.5}),
                    label=" ".join(method),
                )
        for axes in panels[len(gains_db) :]:
            axes.set_visible(False)
        panels[0].set_xticks(range(1, 5))
        figure.supxlabel("severity", fontsize=7)
        figure.supylabel("dB over copying the last frame", fontsize=7)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(methods), fontsize=7)
    return figure
