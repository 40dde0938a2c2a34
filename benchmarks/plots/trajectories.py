"""Where the camera went and where every pose source said it would go, seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.plots import style
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

MOST_PATHS = 10
WIDTH_IN = 5.0
FLATTEST, TALLEST = 0.3, 1.1  # height over width of the axes
NAME_PT = 7.5
LAST_OBSERVED = "last observed camera"
MOST_SAMPLES = 30


@dataclass(frozen=True)
class Path:
    """One pose source's past and futures, as (forward, left) on the last observed camera's x-z plane."""

    label: str
    past: FloatArray  # [P, 2]
    futures: FloatArray  # [S, F, 2]
    stroke: style.Stroke


def from_above(
    world_from_cam: FloatArray,  # [..., 4, 4]
    world_from_last: FloatArray,  # [4, 4]
) -> FloatArray:
    """(forward, left) [..., 2] of every camera in the last observed camera's frame: its z and minus its x."""
    last_from_cam = se3.inverse(world_from_last) @ world_from_cam
    return np.stack([last_from_cam[..., 2, 3], -last_from_cam[..., 0, 3]], axis=-1)


def draw(truth: Path, paths: Sequence[Path], unit: str, words: style.Words) -> list[Figure]:
    """One figure per ten paths, with the truth in black; axes are equal and shared by all pages."""
    pages = style.pages(len(paths), MOST_PATHS)
    limits = _limits([truth, *paths])
    return [
        _page(truth, paths[page.start : page.stop], limits, unit, words.numbered(n, len(pages)))
        for n, page in enumerate(pages, 1)
    ]


def _page(truth: Path, paths: Sequence[Path], limits: FloatArray, unit: str, words: style.Words) -> Figure:
    (left, right), (low, high) = limits
    names_in = style.width_in([*(path.label for path in paths), LAST_OBSERVED], NAME_PT)
    height_in = WIDTH_IN * (high - low) / (right - left)
    figure, axes = style.sheet((WIDTH_IN, height_in), style.Margins(right_in=names_in + 0.75), words)
    style.tidy(axes)
    past = axes.plot(*truth.past.T, color=style.RULE, linewidth=3, solid_capstyle="round")
    lines = [*past, _path(axes, truth, width=3), *(_path(axes, path) for path in paths)]
    lines += axes.plot(0, 0, marker=">", markersize=8, color=style.TRUTH, linestyle="")
    names = ["past", truth.label, *(path.label for path in paths), LAST_OBSERVED]
    axes.legend(
        lines, names, loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False, fontsize=NAME_PT, handlelength=3.2
    )
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    axes.set_aspect("equal")
    axes.set_xlabel(f"forward ({unit})", color=style.INK)
    axes.set_ylabel(f"left ({unit})", color=style.INK)
    return figure


def _path(axes: Axes, path: Path, width: float = 1.3) -> Line2D:
    """The first sample as a full line from the last observed camera, marked every fifth step; the others hair-thin."""
    for future in path.futures[1:MOST_SAMPLES]:
        axes.plot(*_from_origin(future).T, color=path.stroke.colour, linewidth=0.4, alpha=0.35, zorder=1.8)
    axes.plot(*path.past.T, color=path.stroke.colour, linestyle=path.stroke.dash, linewidth=0.6, alpha=0.7)
    every = list(range(5, path.futures.shape[1] + 1, 5))
    line = path.stroke.line(width)
    return axes.plot(*_from_origin(path.futures[0]).T, **line, markevery=every)[0]


def _from_origin(future: FloatArray) -> FloatArray:
    return np.concatenate([np.zeros((1, 2)), future])


def _limits(paths: Sequence[Path]) -> FloatArray:
    """[[left, right], [low, high]] around everything, in a shape that suits a page."""
    points = np.concatenate([np.concatenate([path.past, path.futures[:MOST_SAMPLES].reshape(-1, 2)]) for path in paths])
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    size = np.maximum((points.max(axis=0) - points.min(axis=0)) * 1.1, 1.0)
    size = np.array([max(size[0], size[1] / TALLEST), max(size[1], FLATTEST * size[0])])
    return np.stack([centre - size / 2, centre + size / 2], axis=-1)
