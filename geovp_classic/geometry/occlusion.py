"""The background next to a hole: a moving camera uncovers what the surface in front hid."""

import numba
import numpy as np

from geovp_classic.types import BoolArray, FloatArray, IntArray


def background_pixels(
    is_known: BoolArray,  # [H, W]
    depth: FloatArray,  # [H, W], larger = farther; any order will do
) -> IntArray:
    """Return the flat index [H, W] of the pixel that each pixel is copied from.

    Known pixels are copied from themselves. An unknown pixel is copied from the farther one of the
    known pixels left and right in its row, of equally far ones from the nearer. Rows without any
    known pixel are copied from the row above or below in the same manner.
    """
    index = np.arange(is_known.size).reshape(is_known.shape)
    _copy_farther(np.ascontiguousarray(is_known), np.ascontiguousarray(depth), index)
    rows: BoolArray = np.asarray(is_known.any(axis=1))
    if not rows.all():
        down = np.ascontiguousarray(index.T)
        _copy_farther(
            np.repeat(rows[None], is_known.shape[1], axis=0),
            depth.ravel()[down],
            down,
        )
        index = np.ascontiguousarray(down.T)
    return index


@numba.njit(nogil=True, cache=True)
def _copy_farther(
    is_known: BoolArray,  # [H, W]
    depth: FloatArray,  # [H, W]
    index: IntArray,  # [H, W]; unknown pixels take that of the known pixel left or right
) -> None:
    height, width = is_known.shape
    for row in range(height):
        left = -1  # the known columns next to the current one
        right = 0
        for column in range(width):
            if is_known[row, column]:
                left = column
                continue
            if right <= column:
                right = column + 1
                while right < width and not is_known[row, right]:
                    right += 1
            if left < 0 and right == width:
                break
            is_left = right == width
            if left >= 0 and right < width:
                left_depth = depth[row, left]
                right_depth = depth[row, right]
                is_nearer = column - left <= right - column
                is_left = left_depth > right_depth or (left_depth == right_depth and is_nearer)
            index[row, column] = index[row, left if is_left else right]
