"""The path of the camera and the predicted paths, seen from above."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from geovp_benchmarks.plots import style
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Path:
    """Past and futures of one pose source, as (forward, left) from the last observed camera."""

    label: str
    past: FloatArray  # [P, 2]
    futures: FloatArray  # [S, F, 2]
    line: style.LineStyle


def from_above(
    world_from_cam: FloatArray,  # [..., 4, 4]
    world_from_last: FloatArray,  # [4, 4]
) -> FloatArray:
    """Return (forward, left) [..., 2] of cameras in the frame of the last observed camera."""
    last_from_cam = se3.inverse(world_from_last) @ world_from_cam
    return np.stack([last_from_cam[..., 2, 3], -last_from_cam[..., 0, 3]], axis=-1)


def draw(
    truth: Path, paths: Sequence[Path], unit: str, heading: style.Heading, layout: style.Layout
) -> Figure:
    """Draw the paths with equal scales of both axes, the ground truth in black."""
    figure, axes = layout.single_axes((4.8, 3.4), heading)
    lines = axes.plot(*truth.past.T, color=style.RULE, linewidth=3)
    lines += _plot(axes, truth, width=3)
    for path in paths[: layout.max_lines]:
        lines += _plot(axes, path)
    lines += axes.plot(0, 0, marker=">", markersize=8, color=truth.line.colour, linestyle="")
    labels = ["past", truth.label, *(path.label for path in paths[: layout.max_lines])]
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel=f"forward ({unit})", ylabel=f"left ({unit})")
    layout.add_legend(figure, lines, [*labels, "last observed camera"])
    return figure


def _plot(axes: Axes, path: Path, width: float = 1.3, max_samples: int = 30) -> list[Line2D]:
    """Plot the first sample with a mark at every fifth step, and the others as thin lines."""
    from_origin = np.concatenate([np.zeros((len(path.futures), 1, 2)), path.futures], axis=1)
    colour = path.line.colour
    for future in from_origin[1:max_samples]:
        axes.plot(*future.T, color=colour, linewidth=0.4, alpha=0.35, zorder=1.8)
    axes.plot(*path.past.T, color=colour, linestyle=path.line.dash, linewidth=0.6, alpha=0.7)
    marks = list(range(5, from_origin.shape[1], 5))
    return axes.plot(*from_origin[0].T, **path.line.kwargs(width), markevery=marks)
