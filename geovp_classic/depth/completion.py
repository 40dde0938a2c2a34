"""Holes in depth: small islands of wrong matches, and pixels without a match, take the depth of the background."""

from __future__ import annotations

import cv2
import numba
import numpy as np

from geovp_classic.types import BoolArray, FloatArray

SPECKLE_STEP = 2.0


def speckles(
    levels: FloatArray,  # [H, W], depth counted in hypotheses
    largest_share: float,
) -> BoolArray:
    """Islands [H, W] of at most that share of the image, cut off by steps of more than SPECKLE_STEP hypotheses."""
    sixteenths = np.round(16 * levels).astype(np.int16)
    marked = cv2.filterSpeckles(sixteenths, -1, int(largest_share * levels.size), int(16 * SPECKLE_STEP))[0]
    islands: BoolArray = np.asarray(marked) == -1
    return islands


def fill_from_background(
    inverse_depth: FloatArray,  # [H, W]
    known: BoolArray,  # [H, W]
) -> FloatArray:
    """Unknown pixels get the farther of the next known depths left and right, else of those above and below.

    What one eye alone sees lies behind the thing that hides it from the other. Where nothing is known all is at 0.
    """
    filled, done = np.array(inverse_depth, dtype=np.float32), np.array(known, dtype=np.bool_)
    _fill_lines(filled, done)
    _fill_lines(filled.T, done.T)
    return np.where(done, filled, np.float32(0))


@numba.njit(nogil=True, cache=True)
def _fill_lines(
    values: FloatArray,  # [H, W], written
    known: BoolArray,  # [H, W], written
) -> None:
    """Unknown values become the smaller of the next known ones on both sides in their row, and known."""
    height, width = values.shape
    for row in range(height):
        before = -1  # the last known column
        for column in range(width + 1):
            if column < width and not known[row, column]:
                continue
            for gap in range(before + 1, column):
                if before >= 0 and column < width:
                    values[row, gap] = min(values[row, before], values[row, column])
                elif before >= 0 or column < width:
                    values[row, gap] = values[row, before if before >= 0 else column]
            before = column
        if known[row].any():
            known[row] = True
