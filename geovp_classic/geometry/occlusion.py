"""The background beside a hole: what a moving camera uncovers lies behind the surface that hid it."""

from __future__ import annotations

import numpy as np

from geovp_classic.types import BoolArray, FloatArray, IntArray


def background_pixels(
    known: BoolArray,  # [H, W]
    depth: FloatArray,  # [H, W], larger = farther; any order will do
) -> IntArray:
    """For every pixel the flat index [H, W] of the pixel to copy; known pixels name themselves.

    An unknown pixel names the farther one of the known pixels left and right of it in its row, of equally far ones the
    nearer. Rows without any known pixel name the row above or below in the same manner.
    """
    index = np.arange(known.size).reshape(known.shape)
    index = np.take_along_axis(index, _columns(known, depth), axis=1)
    rows = np.broadcast_to(known.any(axis=1, keepdims=True), known.shape)
    if rows.all():
        return index
    return np.take_along_axis(index, _columns(rows.T, depth.ravel()[index].T).T, axis=0)


def _columns(known: BoolArray, depth: FloatArray) -> IntArray:
    """The column [H, W] that each pixel names; its own in a row without any known pixel."""
    column, width = np.arange(known.shape[1]), known.shape[1]
    left = np.maximum.accumulate(np.where(known, column, -1), axis=1)
    right = np.minimum.accumulate(np.where(known, column, width)[:, ::-1], axis=1)[:, ::-1]
    to_left = np.where(left >= 0, np.take_along_axis(depth, np.maximum(left, 0), axis=1), -np.inf)
    to_right = np.where(right < width, np.take_along_axis(depth, np.minimum(right, width - 1), axis=1), -np.inf)
    is_left = (to_left > to_right) | ((to_left == to_right) & (column - left <= right - column))
    return np.where((left < 0) & (right == width), column, np.where(is_left, left, right))
