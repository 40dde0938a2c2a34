"""Curves of the corruption study: gain over copy-last by severity."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from geovp_benchmarks.plots import style
from geovp_classic.types import FloatArray
from studies._figures import panels


def draw_corruptions(
    path: Path,
    gains_db: Mapping[str, Sequence[FloatArray]],  # [M] at each severity, by corruption
    methods: Sequence[str],  # "POSE_SOURCE RENDERER"
    num_columns: int = 5,
) -> None:
    """Draw a panel per corruption and a line per method; with one severity, lines are level."""
    num_rows = -(-len(gains_db) // num_columns)
    lines = style.line_styles([(name.split()[0], name.split()[1]) for name in methods])
    size_in = 1.5 * num_columns, 1.05 * num_rows
    with panels(path, size_in, num_columns, num_rows) as drawn:
        for axes in drawn[len(gains_db) :]:
            axes.set_visible(False)
        for axes, (name, gains) in zip(drawn, gains_db.items(), strict=False):
            axes.set_title(name, fontsize=6.5)
            axes.axhline(0, color="0.5", linewidth=0.8)
            levels = np.broadcast_to(gains, (4, len(methods)))
            for line, values, label in zip(lines, levels.T, methods, strict=True):
                axes.plot(range(1, 5), values, **line, linewidth=1.0, label=label)
        drawn[0].figure.supxlabel("severity", fontsize=7)
        drawn[0].figure.supylabel("dB over copying the last frame", fontsize=7)
