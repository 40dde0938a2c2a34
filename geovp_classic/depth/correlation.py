"""Scores of one source at one hypothesis: one minus the zero-mean normalised cross-correlation of
small windows.

The source is sampled row by row, where the hypothesis puts the pixels of the reference image.
"""

import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.parallel import SAME_BITS
from geovp_classic.types import FloatArray, IntArray

CostArray = npt.NDArray[np.uint8]
PackedArray = npt.NDArray[np.int32]
Buffers = tuple[
    FloatArray, FloatArray, FloatArray, FloatArray, PackedArray, CostArray
]  # see matching._buffers

RADIUS_PX = 2  # of the window; the row sums below are written out for it
NOISE_VARIANCE = 2.0  # of grey values 0..255; windows flatter than this correlate with nothing
IN_FRONT = 1e-6  # smallest z, relative to the ray

_WINDOW = np.float32(1 / (2 * RADIUS_PX + 1) ** 2)
_ZERO, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def clear(
    numbers: FloatArray,  # [N, M, W], written
) -> None:
    """Make all of them zero."""
    for n in range(numbers.shape[0]):
        for m in range(numbers.shape[1]):
            for column in range(numbers.shape[2]):
                numbers[n, m, column] = _ZERO


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def add_band(
    own: tuple[FloatArray, FloatArray, FloatArray],
    lines: IntArray,
    a: FloatArray,  # [3, 3]
    shift: FloatArray,  # [3]
    source: PackedArray,  # [H', W']
    buffers: Buffers,
    scores: FloatArray,  # [rows, 2, W], added to
) -> None:
    """Window sums run down the rows: each row's own sums enter at the bottom and leave at the top
    (ring of 2 r + 1).
    """
    padded, mean, inverse_deviation = own
    _, _, sums, rows, index, _ = buffers
    clear(sums)
    for step in range(len(lines)):
        inside, row, v = rows[step % 5], step - 2 * RADIUS_PX, np.float32(lines[step])
        start = (
            a[0, 1] * v + a[0, 2] + shift[0],
            a[1, 1] * v + a[1, 2] + shift[1],
            a[2, 1] * v + a[2, 2] + shift[2],
        )
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
        upper, above_right = (
            np.float32(np.int32(four & byte)),
            np.float32(np.int32((four >> 8) & byte)),
        )
        lower, below_right = (
            np.float32(np.int32((four >> 16) & byte)),
            np.float32(np.int32((four >> 24) & byte)),
        )
        upper, lower = upper + along * (above_right - upper), lower + along * (below_right - lower)
        warped[column + r] = upper + down * (lower - upper)
    for i in range(r):
        warped[i], warped[width + r + i] = warped[r], warped[width + r - 1]


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def _sum_row(
    warped: FloatArray,  # [W + 2 r]
    own: FloatArray,  # [W + 2 r]
    # [3, W], the sums of the row that leaves the window; replaced by this row's
    leaving: FloatArray,
    running: FloatArray,  # [3, W], sums of warped, warped^2 and warped * own over the window
) -> None:
    for x in range(running.shape[1]):
        j0, j1, j2, j3, j4 = warped[x], warped[x + 1], warped[x + 2], warped[x + 3], warped[x + 4]
        plain = j0 + j1 + j2 + j3 + j4
        square = j0 * j0 + j1 * j1 + j2 * j2 + j3 * j3 + j4 * j4
        product = (
            j0 * own[x] + j1 * own[x + 1] + j2 * own[x + 2] + j3 * own[x + 3] + j4 * own[x + 4]
        )
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
    # [2, W], added to: one minus the correlation, and 1, where the source sees the point
    scores: FloatArray,
) -> None:
    for x in range(len(mean)):
        average = running[0, x] * _WINDOW
        variance = max(running[1, x] * _WINDOW - average * average, _ZERO) + np.float32(
            NOISE_VARIANCE
        )
        covariance = running[2, x] * _WINDOW - mean[x] * average
        disagreement = _ONE - covariance * inverse_deviation[x] / np.sqrt(variance)
        scores[0, x] += inside[x] * min(max(disagreement, _ZERO), _ONE)
        scores[1, x] += inside[x]
