"""Depth without grain: a pixel lies on the plane through those neighbours that are of one surface with it.

In inverse depth every plane is linear in the image (Hartley & Zisserman 2004, section 13.1), so that roads and walls
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
_PER_CONTRAST = np.float32(1 / (32 * SIMILAR))  # exp(-c) is ((1 - c / 32) / (1 + c / 32))^16, nearly (Pade)


def flattened(
    inverse_depth: FloatArray,  # [H, W] float32
    confidence: FloatArray,  # [H, W] float32 in [0, 1]
    image: FloatArray,  # [H, W] float32 grey 0..255
) -> FloatArray:
    """The inverse depth [H, W] by a weighted least-squares plane around every pixel, never negative."""
    q = np.ascontiguousarray(inverse_depth, dtype=np.float32)
    trust = (LEAST_TRUST + (1 - LEAST_TRUST) * confidence).astype(np.float32)
    same = (SAME_SURFACE * np.maximum(q, 0.01 * np.quantile(q, 0.99)) + 1e-12).astype(np.float32)  # far is far
    flat: FloatArray = _flattened(q, trust, np.ascontiguousarray(image, dtype=np.float32), 1 / same)
    return flat


@numba.njit(parallel=True, fastmath=True, cache=True, error_model="numpy")
def _flattened(q: FloatArray, trust: FloatArray, image: FloatArray, sharpness: FloatArray) -> FloatArray:
    height, width = q.shape
    result = np.empty((height, width), np.float32)
    for row in numba.prange(height):
        sums = np.zeros((9, width), np.float32)  # of w, wu, wv, wuu, wuv, wvv, wd, wdu, wdv; d: off the pixel's own
        for i in range(-REACH, REACH + 1):
            start, stop = max(0, -STEP_PX * i), min(width, width - STEP_PX * i)
            if start >= stop:
                continue
            there = slice(start + STEP_PX * i, stop + STEP_PX * i)
            here = q[row, start:stop], image[row, start:stop], sharpness[row, start:stop]
            column = np.zeros((5, stop - start), np.float32)  # of w, wv, wvv, wd, wdv
            for j in range(-REACH, REACH + 1):
                y = row + STEP_PX * j
                if 0 <= y < height:
                    _add(column, q[y, there], trust[y, there], image[y, there], here, np.float32(j))
            _join(sums[:, start:stop], column, np.float32(i))
        _heights(sums, q[row], result[row])
    return result


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _add(
    sums: FloatArray,  # [5, N], added to: w, wv, wvv, wd, wdv
    q: FloatArray,  # [N], of the neighbours
    trust: FloatArray,  # [N]
    image: FloatArray,  # [N]
    here: tuple[FloatArray, FloatArray, FloatArray],  # [N] each: inverse depth, image and sharpness of the pixels
    v: np.float32,
) -> None:
    own, looks, sharpness = here
    for x in range(sums.shape[1]):
        contrast = abs(image[x] - looks[x]) * _PER_CONTRAST
        near, far = _to_the_sixteenth(_ONE - contrast), _to_the_sixteenth(_ONE + contrast)  # their ratio: a falling exp
        off = q[x] - own[x]
        apart = _ONE + (off * sharpness[x]) * (off * sharpness[x])
        weight = trust[x] * near / (far * apart * apart)
        sums[0, x] += weight
        sums[1, x] += weight * v
        sums[2, x] += weight * v * v
        sums[3, x] += weight * off
        sums[4, x] += weight * off * v


@numba.njit(fastmath=True, cache=True, error_model="numpy", inline="always")
def _to_the_sixteenth(base: np.float32) -> np.float32:
    square = base * base
    fourth = square * square
    return fourth * fourth * fourth * fourth


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _join(sums: FloatArray, column: FloatArray, u: np.float32) -> None:
    """Add a column of neighbours, all at the same u, to the sums [9, N]."""
    for x in range(column.shape[1]):
        weight, weight_v, off = column[0, x], column[1, x], column[3, x]
        sums[0, x] += weight
        sums[1, x] += weight * u
        sums[2, x] += weight_v
        sums[3, x] += weight * u * u
        sums[4, x] += weight_v * u
        sums[5, x] += column[2, x]
        sums[6, x] += off
        sums[7, x] += off * u
        sums[8, x] += column[4, x]


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _heights(sums: FloatArray, q: FloatArray, result: FloatArray) -> None:
    """The planes' values [W] at u = v = 0: normal equations about the mean, two unknown slopes (Cramer's rule)."""
    for x in range(len(q)):
        share = _ONE / sums[0, x]
        u, v, off = sums[1, x] * share, sums[2, x] * share, sums[6, x] * share
        stiff = np.float32(STIFFNESS) * (sums[3, x] + sums[5, x]) + np.float32(1e-12)
        uu, vv = sums[3, x] - u * sums[1, x] + stiff, sums[5, x] - v * sums[2, x] + stiff
        uv, ud, vd = sums[4, x] - u * sums[2, x], sums[7, x] - u * sums[6, x], sums[8, x] - v * sums[6, x]
        height = off - (u * (ud * vv - vd * uv) + v * (vd * uu - ud * uv)) / (uu * vv - uv * uv)
        result[x] = max(q[x] + height, np.float32(0))
