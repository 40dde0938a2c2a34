"""Mask of non-scene pixels: letterbox bars, the ego vehicle, and a mask drawn by the user.

Parts of the ego vehicle, such as the hood, stay in place below a lasting edge while the rest of the
image moves. To a reconstruction they are a surface that moves with the camera.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.types import BoolArray, ByteArray

Window = tuple[slice, slice]  # rows and columns


@dataclass(frozen=True)
class SceneMasking:
    """Detection of letterbox bars and the ego vehicle; grey values are 0..255."""

    max_bar_grey: float = 20.0  # brightest pixel of a bar
    # Of a bar, over that of the image; dark footage is not letterboxing.
    max_bar_brightness_fraction: float = 0.1
    max_lit_fraction: float = 0.02  # of a bar's line that may be brighter
    # Of the height and the width, between bars.
    min_content_fraction: float = 0.5
    bar_border_px: int = 2  # blended with the bars by video coding
    min_frames: int = 3  # fewer frames show no ego vehicle
    min_rows: int = 64  # nor do smaller images
    # Standard deviation of a pixel of the ego vehicle over the frames.
    max_still_deviation: float = 3.0
    # Mean change of the scene from the first to the last frame.
    min_motion_difference: float = 3.0
    max_vehicle_height_fraction: float = 0.4  # of the image
    min_vehicle_width_fraction: float = 0.6  # of the lowest row
    min_edge: float = 12.0  # grey values across the vehicle's border
    # Of the frames with that edge; a shadow has one in single frames.
    min_edge_frames_fraction: float = 0.75
    edge_margin_px: int = 3  # to both sides of the border
    # The border rises by at most this fraction of the height above its
    # quantile; what rises more is smooth road.
    max_rise_fraction: float = 0.03
    rise_quantile: float = 1 / 3

    def content_window(
        self,
        greys: ByteArray,  # [P, H, W]
    ) -> Window:
        """Return the rows and columns between letterbox bars."""
        brightest = greys.max(axis=0)
        return self._content_lines(brightest), self._content_lines(brightest.T)

    def ego_vehicle(
        self,
        greys: ByteArray,  # [P, H, W], usable frames
    ) -> BoolArray:
        """Return the mask [H, W] of what stays in place at the bottom while the rest moves."""
        nothing = np.zeros(greys.shape[1:], bool)
        height = len(nothing)
        margin_px = self.edge_margin_px
        if len(greys) < self.min_frames or height < self.min_rows:
            return nothing
        bottom = greys[:, -margin_px:].mean(axis=1)
        is_still = bottom.std(axis=0) < self.max_still_deviation
        if is_still.mean() < self.min_vehicle_width_fraction:
            return nothing

        mask = self._still_region(greys.astype(np.float32))
        columns = np.flatnonzero(mask.any(axis=0))
        if mask[-1].mean() < self.min_vehicle_width_fraction:
            return nothing
        border = mask.argmax(axis=0)[columns]
        if border.min() <= margin_px:
            return nothing
        lowest = np.minimum(border + margin_px, height - 1)
        above = greys[:, border - margin_px, columns].astype(np.float32)
        below = greys[:, lowest, columns].astype(np.float32)
        edges = np.median(np.abs(above - below), axis=1)  # of each frame
        edge = np.quantile(edges, 1 - self.min_edge_frames_fraction)
        motion = cv2.absdiff(greys[-1], greys[0])[~mask].mean()
        is_vehicle = edge >= self.min_edge and motion >= self.min_motion_difference
        return mask if is_vehicle else nothing

    def _still_region(self, greys: ByteArray) -> BoolArray:
        """Return the mask [H, W] of the still region at the bottom, without holes."""
        height = greys.shape[1]
        first = round(height * (1 - self.max_vehicle_height_fraction))
        still = np.zeros(greys.shape[1:], np.uint8)
        still[first:] = greys[:, first:].std(axis=0) < self.max_still_deviation
        closed = cv2.morphologyEx(still, cv2.MORPH_CLOSE, np.ones((5, 5)))
        labels = cv2.connectedComponents(closed)[1]
        region = labels == np.bincount(labels[-1]).argmax()
        region &= closed > 0
        columns = np.flatnonzero(region.any(axis=0))
        if len(columns) == 0:
            return region
        tops = np.where(region.any(axis=0), region.argmax(axis=0), height)
        highest = np.quantile(tops[columns], self.rise_quantile)
        tops = np.maximum(tops, highest - self.max_rise_fraction * height)
        return np.asarray(np.arange(height)[:, None] >= tops)

    def _content_lines(self, brightest: ByteArray) -> slice:
        """Return the rows between bars at the top and the bottom of an image [H, W]."""
        num_lines = len(brightest)
        black = min(
            self.max_bar_grey,
            self.max_bar_brightness_fraction * np.quantile(brightest, 0.95),
        )
        is_lit = (brightest > black).mean(axis=1) > self.max_lit_fraction
        lit = np.flatnonzero(is_lit)
        if len(lit) == 0:
            return slice(0, num_lines)
        start = lit[0] + self.bar_border_px if lit[0] > 0 else 0
        stop = lit[-1] + 1
        if stop < num_lines:
            stop -= self.bar_border_px
        if stop - start < self.min_content_fraction * num_lines:
            return slice(0, num_lines)
        return slice(int(start), int(stop))


def read_mask(path: Path, height_px: int, width_px: int) -> BoolArray:
    """Return the nonzero pixels of an image file as a mask [H, W] of that size.

    Raise BadData for a file that is not an image, or whose aspect ratio differs by more than 5 %.
    """
    data = np.frombuffer(files.read_bytes(path), np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if image is None:
        raise BadData(
            f"mask {path} is not an image: give a PNG that is nonzero where no scene is shown"
        )
    height, width = image.shape
    if abs(width * height_px / (height * width_px) - 1) > 0.05:
        raise BadData(
            f"mask {path} has {width}x{height} pixels, the frames {width_px}x{height_px}: give a "
            "mask of the frames' aspect ratio"
        )
    size_px = (width_px, height_px)
    resized = cv2.resize(image, size_px, interpolation=cv2.INTER_NEAREST)
    return np.asarray(resized > 0)


def scene_window(mask: BoolArray) -> Window:
    """Return the columns and rows of a scene mask [H, W] that are nearly free of it.

    Columns are masked by at most three quarters, rows between them by at most a twentieth.
    """
    height = len(mask)
    columns = _longest_run(mask.sum(axis=0) <= 3 / 4 * height)
    between = mask[:, columns]
    rows = _longest_run(between.sum(axis=1) <= between.shape[1] / 20)
    return rows, columns


def _longest_run(is_free: BoolArray) -> slice:
    """Return the longest run of True in a mask [N]."""
    ends = np.flatnonzero(np.diff(np.pad(is_free, 1).astype(int)))
    starts, stops = ends[::2], ends[1::2]
    if len(starts) == 0:
        return slice(0, 0)
    index = (stops - starts).argmax()
    return slice(int(starts[index]), int(stops[index]))
