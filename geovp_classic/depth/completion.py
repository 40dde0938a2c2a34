"""Depth completion: islands of wrong matches, and pixels without a match, take the background's
depth.
"""

import cv2
import numpy as np

from geovp_classic.geometry.occlusion import background_pixels
from geovp_classic.types import BoolArray, FloatArray


def find_islands(
    levels: FloatArray,  # [H, W], depth counted in planes
    max_fraction: float,
    max_step: float,  # planes, between neighbours of the same surface
) -> BoolArray:
    """Mask islands [H, W] of depth that cover at most a fraction of the image."""
    # OpenCV takes fixed-point disparities, as its stereo matchers return them.
    sixteenths = np.round(16 * levels).astype(np.int16)
    max_pixels = int(max_fraction * levels.size)
    marked, _ = cv2.filterSpeckles(sixteenths, -1, max_pixels, int(16 * max_step))
    return np.asarray(marked) == -1


def fill_from_background(
    inverse_depth: FloatArray,  # [H, W]
    is_known: BoolArray,  # [H, W]
) -> FloatArray:
    """Fill unknown pixels with the farther of the next known depths left and right, else of those
    above and below; with 0 where nothing is known.

    What only one of two cameras sees lies behind the object that hides it from the other.
    """
    if not is_known.any():
        return np.zeros(inverse_depth.shape, np.float32)
    pixels = background_pixels(is_known, -inverse_depth)
    return np.asarray(inverse_depth, np.float32).ravel()[pixels]


def upper_part(is_region: BoolArray) -> BoolArray:
    """Return the connected parts [H, W] of a region that reach the upper border."""
    # What hangs on by less than five pixels is another part.
    opened = cv2.morphologyEx(is_region.view(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    num_parts, parts = cv2.connectedComponents(opened, connectivity=4)
    is_upper = np.zeros(num_parts, bool)
    is_upper[parts[0]] = True
    is_upper[0] = False
    return np.asarray(is_upper[parts])
