"""Depth edges of an image, whose pixels may show a mixture of two surfaces.

While both surfaces move together in the image, the mixture moves with them and stays right; once
they separate, it belongs to neither.
"""

import numpy as np

from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.rendering.patches import PatchModel
from geovp_classic.types import BoolArray, FloatArray


def separated_edges(
    inverse_depth: FloatArray,  # [H, W], NaN where unknown
    epipolar: Epipolar,  # from the image to a view
    min_gap_px: float,
    model: PatchModel,
) -> BoolArray:
    """Return the pixels [H, W] beside a depth edge whose two sides a view shows that far apart.

    Both pixels of a pair lie at their own depth and on the plane of the other one; the view shows
    either pixel at two places.
    """
    slopes = model.slopes(inverse_depth)
    pixels, _ = epipolar.project(inverse_depth)

    def gap_px(other_depth: FloatArray) -> FloatArray:
        other_pixels, _ = epipolar.project(np.maximum(other_depth, 0))
        gap = np.linalg.norm(other_pixels - pixels, axis=-1)
        return np.asarray(gap)

    is_separated = np.zeros(inverse_depth.shape, bool)
    for axis, slope in ((1, slopes[..., 0]), (0, slopes[..., 1])):
        next_plane = np.roll(inverse_depth - slope, -1, axis)
        previous_plane = np.roll(inverse_depth + slope, 1, axis)
        gap_to_next = gap_px(next_plane)
        gap_to_previous = np.roll(gap_px(previous_plane), -1, axis)
        is_edge = np.minimum(gap_to_next, gap_to_previous) >= min_gap_px
        last = [slice(None), slice(None)]
        last[axis] = slice(-1, None)
        is_edge[tuple(last)] = False  # which has no next pixel
        is_separated |= is_edge | np.roll(is_edge, 1, axis)
    return is_separated
