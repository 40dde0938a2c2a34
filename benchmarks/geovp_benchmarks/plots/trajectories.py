"""The camera's path and the paths that the pose sources predicted, seen from above."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from geovp_benchmarks.plots import style
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

MOST_PATHS = 10
MOST_SAMPLES = 30
WIDTH_IN = 5.0
FLATTEST, TALLEST = 0.3, 1.1  # height over width of the axes


@dataclass(frozen=True)
class Path:
    """One pose source's past and futures, as (forward, left) on the last observed camera's x-z
    plane.
    """

    label: str
    past: FloatArray  # [P, 2]
    futures: FloatArray  # [S, F, 2]
    line: style.LineStyle


def from_above(
    world_from_cam: FloatArray,  # [..., 4, 4]
    world_from_last: FloatArray,  # [4, 4]
) -> FloatArray:
    """(forward, left) [..., 2] of every camera in the last observed camera's frame: its z and minus
    its x.
    """
    last_from_cam = se3.inverse(world_from_last) @ world_from_cam
    return np.stack([last_from_cam[..., 2, 3], -last_from_cam[..., 0, 3]], axis=-1)


def draw(truth: Path, paths: Sequence[Path], unit: str, heading: style.Heading) -> list[Figure]:
    """One figure per ten paths, with the ground truth in black; all pages share their axes, of
    equal aspect.
    """
    limits, pages = _limits([truth, *paths]), style.pages(len(paths), MOST_PATHS, heading)
    return [_page(truth, paths[page], limits, unit, own) for page, own in pages]


def _page(
    truth: Path, paths: Sequence[Path], limits: FloatArray, unit: str, heading: style.Heading
) -> Figure:
    (left, right), (low, high) = limits
    figure, axes = style.single_axes((WIDTH_IN, WIDTH_IN * (high - low) / (right - left)), heading)
    past = axes.plot(*truth.past.T, color=style.RULE, linewidth=3, solid_capstyle="round")
    lines = [
        *past,
        *_plot(axes, truth, width=3),
        *(line for path in paths for line in _plot(axes, path)),
    ]
    lines += axes.plot(0, 0, marker=">", markersize=8, color=truth.line.colour, linestyle="")
    names = ["past", truth.label, *(path.label for path in paths), "last observed camera"]
    axes.legend(lines, names, loc="center left", bbox_to_anchor=(1.02, 0.5))
    axes.set(xlim=(left, right), ylim=(low, high), aspect="equal")
    axes.set(xlabel=f"forward ({unit})", ylabel=f"left ({unit})")
    return figure


def _plot(axes: Axes, path: Path, width: float = 1.3) -> list[Line2D]:
    """The first sample as a full line from the last observed camera, marked every fifth step; the
    others hair-thin.
    """
    from_origin = np.concatenate([np.zeros((len(path.futures), 1, 2)), path.futures], axis=1)
    for future in from_origin[1:MOST_SAMPLES]:
        axes.plot(*future.T, color=path.line.colour, linewidth=0.4, alpha=0.35, zorder=1.8)
    axes.plot(
        *path.past.T, color=path.line.colour, linestyle=path.line.dash, linewidth=0.6, alpha=0.7
    )
    every = list(range(5, from_origin.shape[1], 5))
    return axes.plot(*from_origin[0].T, **path.line.kwargs(width), markevery=every)


def _limits(paths: Sequence[Path]) -> FloatArray:
    """[[left, right], [low, high]] around everything, between FLATTEST and TALLEST."""
    points = np.concatenate(
        [np.concatenate([path.past, path.futures[:MOST_SAMPLES].reshape(-1, 2)]) for path in paths]
    )
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    size = np.maximum((points.max(axis=0) - points.min(axis=0)) * 1.1, 1.0)
    size = np.array([max(size[0], size[1] / TALLEST), max(size[1], FLATTEST * size[0])])
    return np.stack([centre - size / 2, centre + size / 2], axis=-1)
