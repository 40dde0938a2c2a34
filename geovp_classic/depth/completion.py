"""Depth that follows the image: unsure pixels take over the depth of sure neighbours that look like them.

A weighted median (Ma 2013) only ever picks depths that are there, so that it moves the edge of a thing to where the
image has one, and never makes up a depth between a thing and its background.
"""

from __future__ import annotations

import cv2
import numba
import numpy as np

from geovp_classic.types import BoolArray, FloatArray

RADIUS_PX = 3
LEAST_TRUST = 0.3  # the say of a pixel of confidence 0, beside 1 for a sure one
SPECKLE_STEP = 2.0
SIMILAR = 20.0  # grey values 0..255 by which a neighbour's say falls to 1 / e


def complete(
    inverse_depth: FloatArray,  # [H, W] float32
    confidence: FloatArray,  # [H, W] float32 in [0, 1]
    image: FloatArray,  # [H, W] float32 grey 0..255
) -> FloatArray:
    """The inverse depth [H, W] by the weighted median of every other pixel (a chequer) of windows of 7 x 7."""
    trust = (LEAST_TRUST + (1 - LEAST_TRUST) * confidence).astype(np.float32)
    likeness = np.exp(-np.arange(256) / SIMILAR).astype(np.float32)
    values = [np.ascontiguousarray(one, dtype=np.float32) for one in (inverse_depth, image)]
    completed: FloatArray = _weighted_median(values[0], trust, values[1], likeness)
    return completed


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


@numba.njit(parallel=True, fastmath=True, cache=True)
def _weighted_median(values: FloatArray, trust: FloatArray, image: FloatArray, likeness: FloatArray) -> FloatArray:
    height, width = values.shape
    result = np.empty((height, width), np.float32)
    for row in numba.prange(height):
        near = np.empty((2 * RADIUS_PX + 1) ** 2, np.float32)
        say = np.empty((2 * RADIUS_PX + 1) ** 2, np.float32)
        for column in range(width):
            count, whole = 0, np.float32(0)
            for y in range(max(row - RADIUS_PX, 0), min(row + RADIUS_PX + 1, height)):
                for x in range(max(column - RADIUS_PX, 0), min(column + RADIUS_PX + 1, width)):
                    if (x - column + y - row) % 2 != 0:
                        continue
                    contrast = int(abs(image[y, x] - image[row, column]))
                    near[count] = values[y, x]
                    say[count] = trust[y, x] * likeness[min(255, contrast)]
                    whole += say[count]
                    count += 1
            best = np.float32(np.inf)
            for i in range(count):
                if near[i] < best and _say_up_to(near[i], near, say, count) >= np.float32(0.5) * whole:
                    best = near[i]
            result[row, column] = best
    return result


@numba.njit(fastmath=True, cache=True)
def _say_up_to(limit: np.float32, near: FloatArray, say: FloatArray, count: int) -> np.float32:
    total = np.float32(0)
    for i in range(count):
        total += say[i] if near[i] <= limit else np.float32(0)
    return total
