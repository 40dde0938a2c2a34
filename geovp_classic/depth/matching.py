"""Matching costs of a plane sweep: how badly images agree with a reference image at given inverse depths.

The measure is one minus the zero-mean normalised cross-correlation (ZNCC) of small windows, which neither gain nor
offset of the exposure changes. Planes face the reference camera (Collins 1996).
"""

from __future__ import annotations

import cv2
import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.parallel import SAME_BITS, parallel_map
from geovp_classic.types import BoolArray, FloatArray, IntArray

CostArray = npt.NDArray[np.uint8]

RADIUS_PX = 2  # of the window; the row sums below are written out for it
WORST = 247  # the cost of windows that don't correlate
FAR_PRIOR = 8  # what the nearest hypothesis costs more than infinity
UNSEEN = 128  # the cost where no source sees the point: neither good nor bad
NOISE_VARIANCE = 2.0  # of grey values 0..255; windows flatter than this correlate with nothing
IN_FRONT = 1e-6  # smallest z, relative to the ray
BAND_ROWS = 32  # that a thread works on at a time, so that they stay in its cache
NEAR_SHARE, STRIDE = 1 / 3, 4  # see near_sources; hypotheses from one comparison with these to the next
BLOCK = 16  # hypotheses whose costs are written at a time: one by one they lie far apart

_WINDOW = np.float32(1 / (2 * RADIUS_PX + 1) ** 2)
_ZERO, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)
_WORST, _UNSEEN, _LEAST_SEEN = np.float32(WORST), np.float32(UNSEEN), np.float32(1 / 8)

PackedArray = npt.NDArray[np.int32]
Buffers = tuple[FloatArray, FloatArray, FloatArray, FloatArray, PackedArray, CostArray]  # see _buffers


def sweep_costs(
    reference: FloatArray,  # [H, W] float32 grey
    sources: FloatArray,  # [S, H', W'] grey, whole numbers 0..255
    infinity_from_pixel: FloatArray,  # [S, 3, 3]; K' R inv(K): where a source shows points at infinity
    epipoles: FloatArray,  # [S, 3]; K' t: what a unit of inverse depth adds
    inverse_depths: FloatArray,  # [N], the hypotheses
    out: CostArray | None = None,  # [H, W, N], where the costs are written
) -> CostArray:
    """Costs [H, W, N]: the mean over the sources that see it, 0 (equal) to WORST, else UNSEEN; plus `far_prior`.

    From one hypothesis to the next the image of a near source hardly moves: it is compared at every STRIDE-th one, and
    its scores are interpolated between.
    """
    window, num = (2 * RADIUS_PX + 1,) * 2, len(inverse_depths)
    mean = np.asarray(cv2.boxFilter(reference, -1, window, borderType=cv2.BORDER_REPLICATE), np.float32)
    square = np.asarray(cv2.boxFilter(reference * reference, -1, window, borderType=cv2.BORDER_REPLICATE), np.float32)
    inverse_deviation = (1 / np.sqrt(np.maximum(square - mean * mean, 0) + NOISE_VARIANCE)).astype(np.float32)
    shifts = (inverse_depths[:, None] * epipoles[:, None]).astype(np.float32)  # [S, N, 3]
    infinity = infinity_from_pixel.astype(np.float32)
    assert all(np.isfinite(one).all() for one in (infinity, shifts)), "a NaN would read outside the image"
    packed, near = _packed(sources), near_sources(epipoles)
    costs = np.empty((*reference.shape, num), np.uint8) if out is None else out
    padded = np.pad(reference, RADIUS_PX, mode="edge")

    def sweep_band(top: int) -> None:
        band = slice(top, top + BAND_ROWS)
        lines = np.clip(np.arange(top - RADIUS_PX, top + len(mean[band]) + RADIUS_PX), 0, len(reference) - 1)
        own = padded[top : top + len(lines)], mean[band], inverse_deviation[band]
        buffers = _buffers(*mean[band].shape)
        _sweep(own, lines, infinity, shifts, near, packed, far_prior(num), buffers, costs[band])

    parallel_map(sweep_band, range(0, len(reference), BAND_ROWS))
    return costs


def near_sources(
    epipoles: FloatArray,  # [S, 3]
) -> BoolArray:
    """Which sources [S] are near: a hypothesis shifts their images by less than a third of the farthest one's."""
    shift = np.linalg.norm(epipoles, axis=1)
    return np.asarray(shift < NEAR_SHARE * shift.max())


def far_prior(num: int) -> CostArray:
    """What each of the hypotheses [N] costs in itself, so that windows that tell nothing, like the sky's, are far."""
    return (FAR_PRIOR * np.arange(num) // num).astype(np.uint8)


def _packed(sources: FloatArray) -> PackedArray:
    """The four pixels [S, H', W'] between which a value is interpolated, as the bytes of one number."""
    four = np.zeros((*sources.shape, 4), np.uint8)
    below = np.concatenate([sources[:, 1:], sources[:, -1:]], axis=1)
    for n, image in enumerate((sources, below)):
        four[..., 2 * n] = image
        four[..., :-1, 2 * n + 1] = image[..., 1:]
    return four.view("<i4")[..., 0]


def _buffers(rows: int, width: int) -> Buffers:
    """Memory of a band (the last two: whole numbers, costs of a block), made here: compiled, that takes long.

    Scores of a hypothesis, of the near sources at the two compared hypotheses around it, sums over windows, rows.
    """
    row, sums = np.empty((8, width + 2 * RADIUS_PX), np.float32), np.empty((6, 3, width), np.float32)
    scores, near_scores = np.empty((rows, 2, width), np.float32), np.empty((2, rows, 2, width), np.float32)
    return scores, near_scores, sums, row, np.empty(width, np.int32), np.empty((BLOCK, rows, width), np.uint8)


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def _sweep(
    own: tuple[FloatArray, FloatArray, FloatArray],  # padded by r all around; mean, one over deviation [rows, W]
    lines: IntArray,  # [rows + 2 r], the band's and the ones around it
    infinity_from_pixel: FloatArray,  # [S, 3, 3]
    shifts: FloatArray,  # [S, N, 3]
    near: BoolArray,  # [S]
    packed: PackedArray,  # [S, H', W']
    prior: CostArray,  # [N]
    buffers: Buffers,
    costs: CostArray,  # [rows, W, N], written
) -> None:
    scores, near_scores, block, last = buffers[0], buffers[1], buffers[5], costs.shape[2] - 1
    for first in range(0, costs.shape[2], len(block)):
        num = min(len(block), costs.shape[2] - first)
        for k in range(num):
            n = first + k
            start, end = n - n % STRIDE, min(n - n % STRIDE + STRIDE, last)
            before, after = near_scores[n // STRIDE % 2], near_scores[(n // STRIDE + 1) % 2]
            if n == 0:
                _clear(before)
                _add_sources(own, lines, infinity_from_pixel, shifts[:, 0], near, True, packed, buffers, before)
            if n == start:
                _clear(after)
                _add_sources(own, lines, infinity_from_pixel, shifts[:, end], near, True, packed, buffers, after)
            _interpolate(before, after, np.float32(n - start) / np.float32(max(end - start, 1)), scores)
            _add_sources(own, lines, infinity_from_pixel, shifts[:, n], near, False, packed, buffers, scores)
            _finish(scores, prior[first + k], block[k])
        for row in range(costs.shape[0]):
            for column in range(costs.shape[1]):
                for k in range(num):
                    costs[row, column, first + k] = block[k, row, column]


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def _finish(
    scores: FloatArray,  # [rows, 2, W]
    prior: np.uint8,
    costs: CostArray,  # [rows, W], written
) -> None:
    for row in range(costs.shape[0]):
        for column in range(costs.shape[1]):
            seen = scores[row, 1, column]
            cost = _WORST * scores[row, 0, column] / max(seen, _LEAST_SEEN) if seen > _ZERO else _UNSEEN
            costs[row, column] = np.uint8(cost) + prior


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def _clear(
    numbers: FloatArray,  # [N, M, W], written
) -> None:
    for n in range(numbers.shape[0]):
        for m in range(numbers.shape[1]):
            for column in range(numbers.shape[2]):
                numbers[n, m, column] = _ZERO


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def _interpolate(
    before: FloatArray,  # [rows, 2, W]
    after: FloatArray,  # [rows, 2, W]
    share: np.float32,
    between: FloatArray,  # [rows, 2, W], written
) -> None:
    for row in range(between.shape[0]):
        for i in range(2):
            for column in range(between.shape[2]):
                first = before[row, i, column]
                between[row, i, column] = first + share * (after[row, i, column] - first)


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def _add_sources(
    own: tuple[FloatArray, FloatArray, FloatArray],
    lines: IntArray,
    infinity_from_pixel: FloatArray,  # [S, 3, 3]
    shifts: FloatArray,  # [S, 3]
    near: BoolArray,  # [S]
    chosen: bool,  # the near ones, or the others
    packed: PackedArray,  # [S, H', W']
    buffers: Buffers,
    scores: FloatArray,  # [rows, 2, W], added to
) -> None:
    for s in range(len(packed)):
        if near[s] == chosen:
            _add_band(own, lines, infinity_from_pixel[s], shifts[s], packed[s], buffers, scores)


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def _add_band(
    own: tuple[FloatArray, FloatArray, FloatArray],
    lines: IntArray,
    a: FloatArray,  # [3, 3]
    shift: FloatArray,  # [3]
    source: PackedArray,  # [H', W']
    buffers: Buffers,
    scores: FloatArray,  # [rows, 2, W], added to
) -> None:
    """Window sums run down the rows: each row's own sums enter at the bottom and leave at the top (ring of 2 r + 1)."""
    padded, mean, inverse_deviation = own
    _, _, sums, rows, index, _ = buffers
    _clear(sums)
    for step in range(len(lines)):
        inside, row, v = rows[step % 5], step - 2 * RADIUS_PX, np.float32(lines[step])
        start = a[0, 1] * v + a[0, 2] + shift[0], a[1, 1] * v + a[1, 2] + shift[1], a[2, 1] * v + a[2, 2] + shift[2]
        _aim_row((a[0, 0], a[1, 0], a[2, 0]), start, source.shape, rows[5], rows[6], index, inside)
        _read_row(source, rows[5], rows[6], index, rows[7])
        _sum_row(rows[7], padded[step], sums[step % 5], sums[5])
        if row >= 0:
            inside = rows[(step + RADIUS_PX + 1) % 5]  # r rows above the one just read
            _score_row(sums[5], mean[row], inverse_deviation[row], inside, scores[row])


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def _aim_row(
    slope: tuple[np.float32, np.float32, np.float32],
    start: tuple[np.float32, np.float32, np.float32],
    size: tuple[int, int],  # H', W'
    part_u: FloatArray,  # [W + 2 r], written: the fraction between two columns
    part_v: FloatArray,  # [W + 2 r], written: the fraction between two rows
    index: npt.NDArray[np.int32],  # [W], written: the pixel above and left
    inside: FloatArray,  # [W + 2 r], written: 1 where the source sees the point
) -> None:
    last_u, last_v = np.float32(size[1] - 1.001), np.float32(size[0] - 1.001)
    for column in range(len(index)):
        c = np.float32(column)
        scale = _ONE / max(slope[2] * c + start[2], np.float32(IN_FRONT))
        u, v = (slope[0] * c + start[0]) * scale, (slope[1] * c + start[1]) * scale
        u_in, v_in = min(max(u, _ZERO), last_u), min(max(v, _ZERO), last_v)
        inside[column] = _ONE if max(abs(u - u_in), abs(v - v_in)) <= _HALF else _ZERO
        whole_u, whole_v = np.int32(u_in), np.int32(v_in)
        part_u[column], part_v[column] = u_in - np.float32(whole_u), v_in - np.float32(whole_v)
        index[column] = whole_v * np.int32(size[1]) + whole_u


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def _read_row(
    source: PackedArray,  # [H', W']
    part_u: FloatArray,
    part_v: FloatArray,
    index: npt.NDArray[np.int32],  # [W], changed
    warped: FloatArray,  # [W + 2 r], written
) -> None:
    width, r, byte, flat = len(index), RADIUS_PX, np.int32(255), source.reshape(-1)
    for column in range(width):  # a loop of its own, so that the compiler vectorises the other one
        index[column] = flat[np.uint64(index[column])]
    for column in range(width):
        four, along, down = index[column], part_u[column], part_v[column]
        upper, above_right = np.float32(np.int32(four & byte)), np.float32(np.int32((four >> 8) & byte))
        lower, below_right = np.float32(np.int32((four >> 16) & byte)), np.float32(np.int32((four >> 24) & byte))
        upper, lower = upper + along * (above_right - upper), lower + along * (below_right - lower)
        warped[column + r] = upper + down * (lower - upper)
    for i in range(r):
        warped[i], warped[width + r + i] = warped[r], warped[width + r - 1]


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
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


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def _score_row(
    running: FloatArray,  # [3, W]
    mean: FloatArray,  # [W]
    inverse_deviation: FloatArray,  # [W]
    inside: FloatArray,  # [W + 2 r]
    scores: FloatArray,  # [2, W], added to: one minus the correlation, and 1, where the source sees the point
) -> None:
    for x in range(len(mean)):
        average = running[0, x] * _WINDOW
        variance = max(running[1, x] * _WINDOW - average * average, _ZERO) + np.float32(NOISE_VARIANCE)
        covariance = running[2, x] * _WINDOW - mean[x] * average
        disagreement = _ONE - covariance * inverse_deviation[x] / np.sqrt(variance)
        scores[0, x] += inside[x] * min(max(disagreement, _ZERO), _ONE)
        scores[1, x] += inside[x]
