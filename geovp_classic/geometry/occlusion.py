"""The background next to a hole: a moving camera uncovers what the surface in front hid."""

import numba
import numpy as np

from geovp_classic.types import BoolArray, FloatArray, IntArray

# Homographies that shift all pixels by one
ALONG_ROWS = np.array([[1.0, 0, 1], [0, 1, 0], [0, 0, 1]])
ALONG_COLUMNS = np.array([[1.0, 0, 0], [0, 1, 1], [0, 0, 1]])


def background_pixels(
    is_known: BoolArray,  # [H, W]
    depth: FloatArray,  # [H, W], larger = farther; any order will do
    motion: FloatArray = ALONG_ROWS,  # [3, 3], a homography
) -> IntArray:
    """Return the flat index [H, W] of the pixel that each pixel is copied from.

    Known pixels are copied from themselves. An unknown pixel is copied from the farther one of the
    next known pixels on both sides of it, of equally far ones from the nearer, on the line along
    which the homography moves it. Where this line has none, the same is done along the row, with
    copies as known pixels, and then along the column. Without any known pixel all stay.
    """
    pixels = np.arange(is_known.size).reshape(is_known.shape)
    index = np.where(is_known, pixels, -1)
    for line in (motion, ALONG_ROWS, ALONG_COLUMNS):
        is_copied = index >= 0
        if is_copied.all():
            break
        _copy_farther(is_copied, depth.ravel()[index], np.asarray(line, np.float64), index)
    return np.where(index < 0, pixels, index)


@numba.njit(nogil=True, cache=True)
def _copy_farther(
    is_known: BoolArray,  # [H, W]
    depth: FloatArray,  # [H, W]
    motion: FloatArray,  # [3, 3]
    index: IntArray,  # [H, W]; unknown pixels take that of a known one on their line, if any
) -> None:
    height, width = is_known.shape
    known_index = index.copy()
    for row in range(height):
        for column in range(width):
            if is_known[row, column]:
                continue
            # The line joins the pixel and its image under the homography.
            x, y, w = motion[:, 0] * column + motion[:, 1] * row + motion[:, 2]
            across, down = x - w * column, y - w * row
            length = np.hypot(across, down)
            if length == 0:
                continue
            # Step to the next known pixel on each side.
            max_depth, min_distance = -np.inf, 0
            for step in (-1 / length, 1 / length):
                distance = 1
                while True:
                    u = int(np.rint(column + distance * step * across))
                    v = int(np.rint(row + distance * step * down))
                    if not (0 <= u < width and 0 <= v < height):
                        break
                    if is_known[v, u]:
                        is_farther = depth[v, u] > max_depth or min_distance == 0
                        is_nearer = depth[v, u] == max_depth and distance < min_distance
                        if is_farther or is_nearer:
                            max_depth, min_distance = depth[v, u], distance
                            index[row, column] = known_index[v, u]
                        break
                    distance += 1
