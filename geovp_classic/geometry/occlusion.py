"""The background beside a hole: what a moving camera uncovers lies behind the
surface that hid it.
"""

import numba
import numpy as np

from geovp_classic.types import BoolArray, FloatArray, IntArray


def background_pixels(
    known: BoolArray,  # [H, W]
    depth: FloatArray,  # [H, W], larger = farther; any order will do
) -> IntArray:
    """For every pixel the flat index [H, W] of the pixel to copy; known pixels name themselves.

    An unknown pixel names the farther one of the known pixels left and right of it in its row, of
    equally far ones the nearer. Rows without any known pixel name the row above or below in the
    same manner.
    """
    index = np.arange(known.size).reshape(known.shape)
    _copy_farther(np.ascontiguousarray(known), np.ascontiguousarray(depth), index)
    rows: BoolArray = np.asarray(known.any(axis=1))
    if not rows.all():
        down = np.ascontiguousarray(index.T)
        _copy_farther(np.repeat(rows[None], known.shape[1], axis=0), depth.ravel()[down], down)
        index = np.ascontiguousarray(down.T)
    return index


@numba.njit(nogil=True, cache=True)
def _copy_farther(
    known: BoolArray,  # [H, W]
    depth: FloatArray,  # [H, W]
    # [H, W], changed: unknown pixels take that of the known pixel at their left or right
    index: IntArray,
) -> None:
    height, width = known.shape
    for row in range(height):
        left, right = -1, 0  # the known columns beside the current one
        for column in range(width):
            if known[row, column]:
                left = column
                continue
            if right <= column:
                right = column + 1
                while right < width and not known[row, right]:
                    right += 1
            if left < 0 and right == width:
                break
            is_left = right == width
            if left >= 0 and right < width:
                at_left, at_right = depth[row, left], depth[row, right]
                is_left = at_left > at_right or (
                    at_left == at_right and column - left <= right - column
                )
            index[row, column] = index[row, left if is_left else right]
