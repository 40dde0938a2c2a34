"""Mask of non-scene pixels: letterbox bars and the ego vehicle.

Parts of the ego vehicle, such as the hood, stay in place below a lasting edge while the rest of the
image moves. To a reconstruction they are a surface that moves with the camera.
"""

import itertools
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.types import BoolArray, ByteArray

Window = tuple[slice, slice]  # rows and columns


@dataclass(frozen=True)
class SceneMasking:
    """Detection of letterbox bars and the ego vehicle; grey values are 0..255."""

    max_bar_grey: float = 20.0  # brightest pixel of a bar
    max_bar_brightness_fraction: float = (
        0.1  # of the image's; dark footage is not letterboxing
    )
    max_lit_fraction: float = 0.02  # of a bar's line that may be brighter
    min_content_fraction: float = (
        0.5  # of the height and the width, between bars
    )
    bar_border_px: int = 2  # blended with the bars by video coding
    min_frames: int = 3  # fewer frames show no ego vehicle
    min_rows: int = 64  # nor do smaller images
    max_still_deviation: float = (
        3.0  # standard deviation of a pixel in place, over the frames
    )
    min_motion_difference: float = (
        3.0  # mean change of the scene from the first to the last frame
    )
    max_vehicle_height_fraction: float = 0.4  # of the image
    min_vehicle_width_fraction: float = 0.6  # of the lowest row
    min_edge: float = 12.0  # grey values across the vehicle's border
    min_edge_frames_fraction: float = (
        0.75  # a shadow's border passes this test in single frames
    )
    edge_margin_px: int = 3  # to both sides of the border
    max_arc_distance_fraction: float = (
        0.03  # of the height: farther above the arc is road
    )
    arc_num_columns: int = 12  # through which candidate arcs are laid
    max_leak_fraction: float = (
        1 / 3
    )  # of the columns that leak into the road above the arc

    def content_window(
        self,
        frames: ByteArray,  # [P, H, W, 3]
    ) -> Window:
        """Return the rows and columns between letterbox bars."""
        rows = self._content_lines(frames)
        columns = self._content_lines(frames.swapaxes(1, 2))
        return rows, columns

    def ego_vehicle(
        self,
        greys: ByteArray,  # [P, H, W], usable frames
    ) -> BoolArray:
        """Return the mask [H, W] of what stays in place at the bottom while the rest moves."""
        nothing = np.zeros(greys.shape[1:], bool)
        if len(greys) < self.min_frames or greys.shape[1] < self.min_rows:
            return nothing
        margin_px = self.edge_margin_px
        bottom = greys[:, -margin_px:].astype(np.float32).mean(axis=1)
        if (
            bottom.std(axis=0) < self.max_still_deviation
        ).mean() < self.min_vehicle_width_fraction:
            return nothing
        first = (
            round(greys.shape[1] * (1 - self.max_vehicle_height_fraction))
            - 2 * margin_px
        )
        grey = greys[:, first:].astype(np.float32)
        still = (grey.std(axis=0) < self.max_still_deviation).astype(np.uint8)
        closed = cv2.morphologyEx(still, cv2.MORPH_CLOSE, np.ones((5, 5)))
        labels = cv2.connectedComponents(closed)[1]
        label = np.bincount(labels[-1]).argmax()
        mask = nothing.copy()
        mask[first:] = labels == label
        mask &= ~self._leaks(mask)
        top = top_row(mask)
        mask[:top] = False
        is_narrow = mask[-1].mean() < self.min_vehicle_width_fraction
        if label == 0 or is_narrow or top <= first + margin_px:
            return nothing
        has_vehicle = mask.any(axis=0)
        tops = mask.argmax(axis=0)
        mask |= (np.arange(len(mask))[:, None] >= tops) & has_vehicle
        columns = np.flatnonzero(has_vehicle)
        border = tops[has_vehicle] - first
        above = grey[:, border - margin_px, columns]
        below = grey[:, np.minimum(border + margin_px, len(still) - 1), columns]
        edges = np.median(np.abs(above - below), axis=1)  # of each frame
        edge = np.quantile(edges, 1 - self.min_edge_frames_fraction)
        motion = np.abs(grey[-1] - grey[0])[~mask[first:]].mean()
        is_vehicle = (
            edge >= self.min_edge and motion >= self.min_motion_difference
        )
        return mask if is_vehicle else nothing

    def _content_lines(self, frames: ByteArray) -> slice:
        """Return the rows between bars at the top and the bottom."""
        num_lines = frames.shape[1]
        ends = [
            (frames[:, end] > self.max_bar_grey).any(axis=(0, 2)).mean()
            for end in (0, -1)
        ]
        if min(ends) > self.max_lit_fraction:
            return slice(0, num_lines)
        brightest = frames.max(axis=(0, 3))
        brightness = np.quantile(brightest, 0.95)
        black = min(
            self.max_bar_grey, self.max_bar_brightness_fraction * brightness
        )
        lit = np.flatnonzero(
            (brightest > black).mean(axis=1) > self.max_lit_fraction
        )
        if len(lit) == 0:
            return slice(0, num_lines)
        start = lit[0] + self.bar_border_px if lit[0] > 0 else 0
        stop = lit[-1] + 1
        if stop < num_lines:
            stop -= self.bar_border_px
        if stop - start < self.min_content_fraction * num_lines:
            return slice(0, num_lines)
        return slice(int(start), int(stop))

    def _leaks(self, mask: BoolArray) -> BoolArray:
        """Return where a mask [H, W] leaks into texture-free road, far above the vehicle's arc.

        The arc is the parabola through three columns' tops with the least truncated errors.
        """
        columns = np.flatnonzero(mask.any(axis=0))
        if len(columns) < 3:
            return np.zeros_like(mask)
        tops = mask.argmax(axis=0)[columns].astype(float)
        bound_px = self.max_arc_distance_fraction * len(mask)
        samples = np.unique(
            np.linspace(0, len(columns) - 1, self.arc_num_columns).astype(int)
        )
        triples = np.array(list(itertools.combinations(samples, 3)))
        powers = np.vander(columns / mask.shape[1], 3)
        arcs = (
            np.linalg.solve(powers[triples], tops[triples][..., None])[..., 0]
            @ powers.T
        )
        errors = np.minimum(np.abs(arcs - tops), bound_px).mean(axis=1)
        arc = arcs[errors.argmin()]
        is_leak = tops < arc - bound_px
        limit = np.zeros(mask.shape[1])
        if is_leak.mean() < self.max_leak_fraction:
            limit[columns[is_leak]] = arc[is_leak]
        return np.arange(len(mask))[:, None] < limit


def scene_window(mask: BoolArray) -> Window:
    """Return the rows and columns of a scene mask [H, W] between the bars, down to the vehicle."""
    rows = np.flatnonzero(~mask.all(axis=1))
    columns = np.flatnonzero(~mask.all(axis=0))
    across = slice(int(columns[0]), int(columns[-1]) + 1)
    top = int(rows[0])
    return slice(top, top + top_row(mask[top:, across])), across


def top_row(mask: BoolArray) -> int:
    """Return the top row of a mask [H, W], robust to single columns; H if it is empty."""
    columns = mask.any(axis=0)
    if not columns.any():
        return len(mask)
    return int(np.quantile(mask.argmax(axis=0)[columns], 0.05))
