"""Reliability diagram of forecasters: how often the truth lies in the region that a forecast gives
a probability.
"""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from geovp_benchmarks.evaluation.forecasting.evaluation import Scores
from geovp_benchmarks.plots import style

PANELS = ("x, z, yaw", "height", "pitch", "roll", "all six")
PANEL_IN = 1.7
NOMINAL = np.linspace(0.05, 0.95, 19)


def reliability_figure(table: Mapping[str, Scores]) -> Figure:
    """A panel each for the motion on the plane, each component over it and all together; a line a
    forecaster.

    On the diagonal a region holds what it says; below it, regions are too small. Rows without a
    distribution are left out.
    """
    known = {name: scores for name, scores in table.items() if np.isfinite(scores.body_rank).all()}
    with mpl.style.context(style.SHEET):
        figure = Figure(figsize=(PANEL_IN * len(PANELS), PANEL_IN), dpi=style.PRINT_DPI)
        panels = figure.subplots(1, len(PANELS), sharey=True)
        for number, (axes, title) in enumerate(zip(panels, PANELS, strict=True)):
            axes.plot([0, 1], [0, 1], color=style.FAINT, linewidth=0.8)
            for (name, scores), line in zip(
                known.items(), style.line_styles([(n, "") for n in known]), strict=True
            ):
                ranks = scores.rank if number == 0 else scores.body_rank[..., number - 1]
                held = [(ranks <= share).mean() for share in NOMINAL]
                axes.plot(
                    NOMINAL, held, color=line.colour, linestyle=line.dash, linewidth=1.2, label=name
                )
            axes.set(title=title, xlabel="probability", aspect="equal", xlim=(0, 1), ylim=(0, 1))
        panels[0].set_ylabel("fraction of true states inside")
        panels[-1].legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
    return figure
