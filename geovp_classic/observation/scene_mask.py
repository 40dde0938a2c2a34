"""Mask of non-scene pixels: letterbox bars, camera-fixed pixels, and a mask drawn by the user."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.types import BoolArray, ByteArray

Window = tuple[slice, slice]  # rows and columns


@dataclass(frozen=True)
class SceneMasking:
    """Detection of letterbox bars; grey values are 0..255."""

    # Brightest pixel of a bar: video black is 16 of 255 (ITU-R BT.601), and coding adds noise
    max_bar_grey: float = 20.0
    # Of a bar, over that of the image; dark footage is not letterboxing.
    max_bar_brightness_fraction: float = 0.1
    # Quantile of the pixels that is the image's brightness: a few lamps or a logo do not count. Set
    # by hand.
    brightness_quantile: float = 0.95
    # Of a bar's line that may be brighter, as of a channel's logo
    max_lit_fraction: float = 0.02
    # Of the height and the width, between bars: a square video in a frame of 16:9 has .56.
    min_content_fraction: float = 0.5
    bar_border_px: int = 2  # blended with the bars by video coding

    def content_window(
        self,
        greys: ByteArray,  # [P, H, W]
    ) -> Window:
        """Return the rows and columns between letterbox bars."""
        brightest = greys.max(axis=0)
        return self._content_lines(brightest), self._content_lines(brightest.T)

    def _content_lines(self, brightest: ByteArray) -> slice:
        """Return the rows between bars at the top and the bottom of an image [H, W]."""
        num_lines = len(brightest)
        black = min(
            self.max_bar_grey,
            self.max_bar_brightness_fraction * np.quantile(brightest, self.brightness_quantile),
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


def read_mask(
    path: Path, height_px: int, width_px: int, max_aspect_error: float = 0.05
) -> BoolArray:
    """Return the nonzero pixels of an image file as a mask [H, W] of that size.

    Raise BadData for a file that is not an image, has transparent pixels, or whose aspect ratio
    differs by more than `max_aspect_error`. Its default is set by hand: a mask of a reduced image
    passes, one of 16:9 for frames of 3:2 (19 % wider) does not.
    """
    data = np.frombuffer(files.read_bytes(path), np.uint8)
    # with 16 bits, too, of which the upper ones may be 0
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH
    image = cv2.imdecode(data, flags) if len(data) else None
    if image is None:
        raise BadData(
            f"mask {path} is not an image: give a PNG that is nonzero where no scene is shown"
        )
    stored: Any = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if stored.ndim == 3 and stored.shape[2] == 4 and np.ptp(stored[..., 3]):
        raise BadData(
            f"mask {path} has transparent pixels, which may mean either: give a PNG without "
            "transparency that is nonzero where no scene is shown"
        )
    height, width = image.shape
    if abs(width * height_px / (height * width_px) - 1) > max_aspect_error:
        raise BadData(
            f"mask {path} has {width}x{height} pixels, the frames {width_px}x{height_px}: give a "
            "mask of the frames' aspect ratio"
        )
    size_px = (width_px, height_px)
    return cv2.resize(image, size_px, interpolation=cv2.INTER_NEAREST) > 0


def scene_window(mask: BoolArray) -> Window:
    """Return the rows and columns of a scene mask [H, W] that show the scene.

    Columns are masked by at most three quarters, rows between them by at most a half. Other masked
    pixels, such as those of a time stamp, stay in the window.
    """
    height = len(mask)
    columns = _longest_run(mask.sum(axis=0) <= 3 / 4 * height)
    between = mask[:, columns]
    rows = _longest_run(between.sum(axis=1) <= between.shape[1] / 2)
    return rows, columns


def _longest_run(is_free: BoolArray) -> slice:
    """Return the longest run of True in a mask [N]."""
    ends = np.flatnonzero(np.diff(np.pad(is_free, 1).astype(int)))
    starts, stops = ends[::2], ends[1::2]
    if len(starts) == 0:
        return slice(0, 0)
    index = (stops - starts).argmax()
    return slice(int(starts[index]), int(stops[index]))
