"""Matching costs of a plane sweep: how badly images agree with a reference image at given inverse depths.

The measure is one minus the zero-mean normalised cross-correlation (ZNCC) of small windows, which neither gain nor
offset of the exposure changes. Planes face the reference camera (Collins 1996).
"""

from __future__ import annotations

import cv2
import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.types import FloatArray

CostArray = npt.NDArray[np.uint8]

RADIUS_PX = 2  # of the window; the row sums below are written out for it
WORST = 247  # the cost of windows that don't correlate
FAR_PRIOR = 8  # what the nearest hypothesis costs more than infinity
UNSEEN = 128  # the cost where no source sees the point: neither good nor bad
NOISE_VARIANCE = 2.0  # of grey values 0..255; windows flatter than this correlate with nothing
IN_FRONT = 1e-6  # smallest z, relative to the ray
BAND_ENTRIES = 2**19  # costs that a thread works on at a time, so that they stay in its cache

_WINDOW = np.float32(1 / (2 * RADIUS_PX + 1) ** 2)
_ZERO, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)


def sweep_costs(
    reference: FloatArray,  # [H, W] float32 grey
    sources: FloatArray,  # [S, H', W'] float32 grey
    infinity_from_pixel: FloatArray,  # [S, 3, 3]; K' R inv(K): where a source shows points at infinity
    epipoles: FloatArray,  # [S, 3]; K' t: what a unit of inverse depth adds
    inverse_depths: FloatArray,  # [N], the hypotheses
) -> CostArray:
    """Costs [H, W, N]: the mean over the sources that see it, 0 (equal) to WORST, else UNSEEN; plus `far_prior`."""
    window = (2 * RADIUS_PX + 1,) * 2
    mean = np.asarray(cv2.boxFilter(reference, -1, window, borderType=cv2.BORDER_REPLICATE), np.float32)
    square = np.asarray(cv2.boxFilter(reference * reference, -1, window, borderType=cv2.BORDER_REPLICATE), np.float32)
    inverse_deviation = (1 / np.sqrt(np.maximum(square - mean * mean, 0) + NOISE_VARIANCE)).astype(np.float32)
    width, num = reference.shape[1], len(inverse_depths)
    num_rows = int(np.clip(BAND_ENTRIES // (width * num), 8, 32))
    maps = infinity_from_pixel.astype(np.float32), epipoles.astype(np.float32), inverse_depths.astype(np.float32)
    assert all(np.isfinite(one).all() for one in maps), "a NaN would read outside the image"
    costs: CostArray = _sweep(reference, mean, inverse_deviation, sources, *maps, far_prior(num), num_rows)
    return costs


def far_prior(num: int) -> CostArray:
    """What each of the hypotheses [N] costs in itself, so that windows that tell nothing, like the sky's, are far."""
    return (FAR_PRIOR * np.arange(num) // num).astype(np.uint8)


@numba.njit(parallel=True, fastmath=True, cache=True, error_model="numpy")
def _sweep(
    reference: FloatArray,
    mean: FloatArray,
    inverse_deviation: FloatArray,
    sources: FloatArray,
    infinity_from_pixel: FloatArray,
    epipoles: FloatArray,
    inverse_depths: FloatArray,
    prior: CostArray,  # [N]
    num_rows: int,
) -> CostArray:
    height, width = reference.shape
    num = len(inverse_depths)
    costs = np.empty((height, width, num), np.uint8)
    for band in numba.prange((height + num_rows - 1) // num_rows):
        top, bottom = band * num_rows, min(height, (band + 1) * num_rows)
        total = np.zeros((num, bottom - top, width), np.float32)
        seen = np.zeros((num, bottom - top, width), np.float32)
        for n in range(num):
            for s in range(len(sources)):
                _add_band(
                    reference,
                    mean,
                    inverse_deviation,
                    sources[s],
                    infinity_from_pixel[s],
                    inverse_depths[n] * epipoles[s],
                    top,
                    total[n],
                    seen[n],
                )
        for row in range(bottom - top):
            for n in range(num):
                for column in range(width):
                    count = seen[n, row, column]
                    cost = np.uint8(UNSEEN)
                    if count > 0:
                        cost = np.uint8(np.float32(WORST) * total[n, row, column] / count)
                    costs[top + row, column, n] = cost + prior[n]
    return costs


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _add_band(
    reference: FloatArray,
    mean: FloatArray,
    inverse_deviation: FloatArray,
    source: FloatArray,
    infinity_from_pixel: FloatArray,  # [3, 3]
    shift: FloatArray,  # [3], the epipole times the inverse depth
    top: int,
    total: FloatArray,  # [rows, W], added to: one minus the correlation
    seen: FloatArray,  # [rows, W], added to: 1 where the source sees the point
) -> None:
    """Window sums run down the rows: each row's own sums enter at the bottom and leave at the top (ring of 2 r + 1)."""
    rows, width = total.shape
    height, size, r = reference.shape[0], 2 * RADIUS_PX + 1, RADIUS_PX
    flat, source_height, source_width = source.reshape(-1), source.shape[0], source.shape[1]
    ring = np.zeros((size, 3, width), np.float32)
    inside = np.zeros((size, width), np.float32)
    running = np.zeros((3, width), np.float32)
    warped, own = np.empty(width + 2 * r, np.float32), np.empty(width + 2 * r, np.float32)
    part_u, part_v, index = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.int32)
    for step in range(rows + 2 * r):
        row = min(max(top + step - r, 0), height - 1)
        slot = step % size
        start = infinity_from_pixel[:, 1] * np.float32(row) + infinity_from_pixel[:, 2] + shift
        slope = infinity_from_pixel[:, 0]
        _aim_row(slope, start, source_width, source_height, part_u, part_v, index, inside[slot])
        _read_row(flat, source_width, index, part_u, part_v, warped)
        for column in range(width):
            own[column + r] = reference[row, column]
        for i in range(r):
            warped[i], warped[width + r + i] = warped[r], warped[width + r - 1]
            own[i], own[width + r + i] = own[r], own[width + r - 1]
        _sum_row(warped, own, ring[slot], running)
        line = step - 2 * r
        if line >= 0:
            centre = inside[(slot + r + 1) % size]  # r rows above the one just read
            _score_row(running, mean[top + line], inverse_deviation[top + line], centre, total[line], seen[line])


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _aim_row(
    slope: FloatArray,  # [3]
    start: FloatArray,  # [3]
    source_width: int,
    source_height: int,
    part_u: FloatArray,  # [W], written: the fraction between two columns
    part_v: FloatArray,  # [W], written: the fraction between two rows
    index: npt.NDArray[np.int32],  # [W], written: the pixel above and left
    inside: FloatArray,  # [W], written: 1 where the source sees the point
) -> None:
    last_u, last_v = np.float32(source_width - 1.001), np.float32(source_height - 1.001)
    for column in range(len(part_u)):
        c = np.float32(column)
        z = slope[2] * c + start[2]
        scale = _ONE / max(z, np.float32(IN_FRONT))
        u, v = (slope[0] * c + start[0]) * scale, (slope[1] * c + start[1]) * scale
        u_in, v_in = min(max(u, _ZERO), last_u), min(max(v, _ZERO), last_v)
        off = max(abs(u - u_in), abs(v - v_in))
        inside[column] = _ONE if off <= _HALF else _ZERO
        whole_u, whole_v = np.int32(u_in), np.int32(v_in)
        part_u[column], part_v[column] = u_in - np.float32(whole_u), v_in - np.float32(whole_v)
        index[column] = whole_v * np.int32(source_width) + whole_u


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _read_row(
    flat: FloatArray,  # [H' W']
    source_width: int,
    index: npt.NDArray[np.int32],
    part_u: FloatArray,
    part_v: FloatArray,
    warped: FloatArray,  # [W + 2 r], written between the margins
) -> None:
    for column in range(len(index)):
        above = np.uint64(index[column])  # unsigned, so that the compiler need not look for negative indices
        below = above + np.uint64(source_width)
        upper = flat[above] + part_u[column] * (flat[above + np.uint64(1)] - flat[above])
        lower = flat[below] + part_u[column] * (flat[below + np.uint64(1)] - flat[below])
        warped[column + RADIUS_PX] = upper + part_v[column] * (lower - upper)


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _sum_row(
    warped: FloatArray,  # [W + 2 r]
    own: FloatArray,  # [W + 2 r]
    leaving: FloatArray,  # [3, W], the sums of the row that leaves the window; replaced by this row's
    running: FloatArray,  # [3, W], sums of warped, warped^2 and warped * own over the window
) -> None:
    for x in range(running.shape[1]):
        j0, j1, j2, j3, j4 = warped[x], warped[x + 1], warped[x + 2], warped[x + 3], warped[x + 4]
        plain = j0 + j1 + j2 + j3 + j4
        square = j0 * j0 + j1 * j1 + j2 * j2 + j3 * j3 + j4 * j4
        product = j0 * own[x] + j1 * own[x + 1] + j2 * own[x + 2] + j3 * own[x + 3] + j4 * own[x + 4]
        running[0, x] += plain - leaving[0, x]
        running[1, x] += square - leaving[1, x]
        running[2, x] += product - leaving[2, x]
        leaving[0, x], leaving[1, x], leaving[2, x] = plain, square, product


@numba.njit(fastmath=True, cache=True, error_model="numpy")
def _score_row(
    running: FloatArray,  # [3, W]
    mean: FloatArray,  # [W]
    inverse_deviation: FloatArray,  # [W]
    inside: FloatArray,  # [W]
    total: FloatArray,  # [W], added to
    seen: FloatArray,  # [W], added to
) -> None:
    for x in range(len(mean)):
        average = running[0, x] * _WINDOW
        variance = max(running[1, x] * _WINDOW - average * average, _ZERO) + np.float32(NOISE_VARIANCE)
        covariance = running[2, x] * _WINDOW - mean[x] * average
        disagreement = _ONE - covariance * inverse_deviation[x] / np.sqrt(variance)
        total[x] += inside[x] * min(max(disagreement, _ZERO), _ONE)
        seen[x] += inside[x]
