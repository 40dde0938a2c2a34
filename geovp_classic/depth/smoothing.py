"""Depth without grain: a pixel lies on the plane through those neighbours that are of one surface with it.

In inverse depth every plane is linear in the picture (Hartley & Zisserman 2004, section 13.1), so that roads and walls
keep their slopes and lose the steps between hypotheses. Neighbours have a say by how sure they are, how much they look
like the pixel and how near their depth is to its own: across the edge of a thing they have none.
"""

from __future__ import annotations

import numba
import numpy as np

from geovp_classic.types import FloatArray

STEP_PX = 2  # of the neighbours, along both axes
REACH = 4  # steps to each side: 9 x 9 neighbours within 8 pixels
LEAST_TRUST = 0.1  # the say of a pixel of confidence 0, beside 1 for a sure one
SIMILAR = 20.0  # grey values 0..255 by which a neighbour's say falls to 1 / e
SAME_SURFACE = 0.1  # relative difference of inverse depths at which it falls to 1 / 4
STIFFNESS = 1e-3  # keeps slopes at 0 where the neighbours lie in a line

_ONE = np.float32(1)


def flattened(
    inverse_depth: FloatArray,  # [H, W] float32
    confidence: FloatArray,  # [H, W] float32 in [0, 1]
    picture: FloatArray,  # [H, W] float32 grey 0..255
) -> FloatArray:
    """The inverse depth [H, W] by a weighted least-squares plane around every pixel, never negative."""
    q = np.ascontiguousarray(inverse_depth, dtype=np.float32)
    trust = (LEAST_TRUST + (1 - LEAST_TRUST) * confidence).astype(np.float32)
    likeness = np.exp(-np.arange(256) / SIMILAR).astype(np.float32)
    same = (SAME_SURFACE * np.maximum(q, 0.01 * np.quantile(q, 0.99)) + 1e-12).astype(np.float32)  # far is far
    flat: FloatArray = _flattened(q, trust, np.ascontiguousarray(picture, dtype=np.float32), likeness, 1 / same)
    return flat


@numba.njit(parallel=True, fastmath=True, cache=True, error_model="numpy")
def _flattened(
    q: FloatArray, trust: FloatArray, picture: FloatArray, likeness: FloatArray, sharpness: FloatArray
) -> FloatArray:
    height, width = q.shape
    result = np.empty((height, width), np.float32)
    for row in numba.prange(height):
        sums = np.zeros(9, np.float32)  # of w, wu, wv, wuu, wuv, wvv, wd, wdu, wdv; d = difference to the pixel
        for column in range(width):
            sums[:] = 0
            for j in range(-REACH, REACH + 1):
                y = row + STEP_PX * j
                if y < 0 or y >= height:
                    continue
                for i in range(-REACH, REACH + 1):
                    x = column + STEP_PX * i
                    if x < 0 or x >= width:
                        continue
                    contrast = int(abs(picture[y, x] - picture[row, column]))
                    off = q[y, x] - q[row, column]
                    apart = _ONE + (off * sharpness[row, column]) ** 2
                    _add(sums, trust[y, x] * likeness[min(255, contrast)] / (apart * apart), i, j, off)
            result[row, column] = max(q[row, column] + _height(sums), np.float32(0))
    return result


@numba.njit(fastmath=True, cache=True, error_model="numpy", inline="always")
def _add(sums: FloatArray, weight: np.float32, i: int, j: int, off: np.float32) -> None:
    u, v = np.float32(i), np.float32(j)
    sums[0] += weight
    sums[1] += weight * u
    sums[2] += weight * v
    sums[3] += weight * u * u
    sums[4] += weight * u * v
    sums[5] += weight * v * v
    sums[6] += weight * off
    sums[7] += weight * off * u
    sums[8] += weight * off * v


@numba.njit(fastmath=True, cache=True, error_model="numpy", inline="always")
def _height(sums: FloatArray) -> np.float32:
    """The plane's value at u = v = 0: normal equations about the mean, two unknown slopes (Cramer's rule)."""
    u, v, off = sums[1] / sums[0], sums[2] / sums[0], sums[6] / sums[0]
    stiff = np.float32(STIFFNESS) * (sums[3] + sums[5]) + np.float32(1e-12)
    uu, vv = sums[3] - u * sums[1] + stiff, sums[5] - v * sums[2] + stiff
    uv, ud, vd = sums[4] - u * sums[2], sums[7] - u * sums[6], sums[8] - v * sums[6]
    share = _ONE / (uu * vv - uv * uv)
    return np.float32(off - (u * (ud * vv - vd * uv) + v * (vd * uu - ud * uv)) * share)
