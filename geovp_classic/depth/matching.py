"""Matching costs of a plane sweep: how badly images agree with a reference image at given inverse
depths.

The measure is one minus the zero-mean normalised cross-correlation (ZNCC) of small windows, which
neither gain nor offset of the exposure changes. Planes face the reference camera (Collins 1996).
"""

import cv2
import numba
import numpy as np

from geovp_classic.depth.correlation import (
    NOISE_VARIANCE,
    RADIUS_PX,
    Buffers,
    CostArray,
    PackedArray,
    add_band,
    clear,
)
from geovp_classic.parallel import SAME_BITS, parallel_map
from geovp_classic.types import BoolArray, FloatArray, IntArray

WORST = 247  # the cost of windows that don't correlate
FAR_PRIOR = 8  # what the nearest hypothesis costs more than infinity
UNSEEN = 128  # the cost where no source sees the point: neither good nor bad
BAND_ROWS = 32  # that a thread works on at a time, so that they stay in its cache
NEAR_SHARE, STRIDE = (
    1 / 3,
    4,
)  # see near_sources; hypotheses from one comparison with these to the next
BLOCK = 16  # hypotheses whose costs are written at a time: one by one they lie far apart

_ZERO, _WORST, _UNSEEN, _LEAST_SEEN = (
    np.float32(0),
    np.float32(WORST),
    np.float32(UNSEEN),
    np.float32(1 / 8),
)


def sweep_costs(
    reference: FloatArray,  # [H, W] float32 grey
    sources: FloatArray,  # [S, H', W'] grey, whole numbers 0..255
    # [S, 3, 3]; K' R inv(K): where a source shows points at infinity
    infinity_from_pixel: FloatArray,
    epipoles: FloatArray,  # [S, 3]; K' t: what a unit of inverse depth adds
    inverse_depths: FloatArray,  # [N], the hypotheses
    out: CostArray | None = None,  # [H, W, N], where the costs are written
) -> CostArray:
    """Costs [H, W, N]: the mean over the sources that see it, 0 (equal) to WORST, else UNSEEN; plus
    `far_prior`.

    From one hypothesis to the next the image of a near source hardly moves: it is compared at every
    STRIDE-th one, and its scores are interpolated between.
    """
    window, num = (2 * RADIUS_PX + 1,) * 2, len(inverse_depths)
    mean = np.asarray(
        cv2.boxFilter(reference, -1, window, borderType=cv2.BORDER_REPLICATE), np.float32
    )
    square = np.asarray(
        cv2.boxFilter(reference * reference, -1, window, borderType=cv2.BORDER_REPLICATE),
        np.float32,
    )
    inverse_deviation = (1 / np.sqrt(np.maximum(square - mean * mean, 0) + NOISE_VARIANCE)).astype(
        np.float32
    )
    shifts = (inverse_depths[:, None] * epipoles[:, None]).astype(np.float32)  # [S, N, 3]
    infinity = infinity_from_pixel.astype(np.float32)
    assert all(np.isfinite(one).all() for one in (infinity, shifts)), (
        "a NaN would read outside the image"
    )
    packed, near = _packed(sources), near_sources(epipoles)
    costs = np.empty((*reference.shape, num), np.uint8) if out is None else out
    padded = np.pad(reference, RADIUS_PX, mode="edge")

    def sweep_band(top: int) -> None:
        band = slice(top, top + BAND_ROWS)
        lines = np.clip(
            np.arange(top - RADIUS_PX, top + len(mean[band]) + RADIUS_PX), 0, len(reference) - 1
        )
        own = padded[top : top + len(lines)], mean[band], inverse_deviation[band]
        buffers = _buffers(*mean[band].shape)
        _sweep(own, lines, infinity, shifts, near, packed, far_prior(num), buffers, costs[band])

    parallel_map(sweep_band, range(0, len(reference), BAND_ROWS))
    return costs


def near_sources(
    epipoles: FloatArray,  # [S, 3]
) -> BoolArray:
    """Which sources [S] are near: a hypothesis shifts their images by less than a third of the
    farthest one's.
    """
    shift = np.linalg.norm(epipoles, axis=1)
    return np.asarray(shift < NEAR_SHARE * shift.max())


def far_prior(num: int) -> CostArray:
    """What each of the hypotheses [N] costs in itself, so that windows that tell nothing, like the
    sky's, are far.
    """
    return (FAR_PRIOR * np.arange(num) // num).astype(np.uint8)


def _packed(sources: FloatArray) -> PackedArray:
    """The four pixels [S, H', W'] between which a value is interpolated, as the bytes of one
    number.
    """
    four = np.zeros((*sources.shape, 4), np.uint8)
    below = np.concatenate([sources[:, 1:], sources[:, -1:]], axis=1)
    for n, image in enumerate((sources, below)):
        four[..., 2 * n] = image
        four[..., :-1, 2 * n + 1] = image[..., 1:]
    return four.view("<i4")[..., 0]


def _buffers(rows: int, width: int) -> Buffers:
    """Memory of a band (the last two: whole numbers, costs of a block), made here: compiled, that
    takes long.

    Scores of a hypothesis, of the near sources at the two compared hypotheses around it, sums over
    windows, rows.
    """
    row, sums = (
        np.empty((8, width + 2 * RADIUS_PX), np.float32),
        np.empty((6, 3, width), np.float32),
    )
    scores, near_scores = (
        np.empty((rows, 2, width), np.float32),
        np.empty((2, rows, 2, width), np.float32),
    )
    return (
        scores,
        near_scores,
        sums,
        row,
        np.empty(width, np.int32),
        np.empty((BLOCK, rows, width), np.uint8),
    )


@numba.njit(nogil=True, fastmath=SAME_BITS, cache=True, error_model="numpy")
def _sweep(
    own: tuple[
        FloatArray, FloatArray, FloatArray
    ],  # padded by r all around; mean, one over deviation [rows, W]
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
                clear(before)
                _add_sources(
                    own,
                    lines,
                    infinity_from_pixel,
                    shifts[:, 0],
                    near,
                    True,
                    packed,
                    buffers,
                    before,
                )
            if n == start:
                clear(after)
                _add_sources(
                    own,
                    lines,
                    infinity_from_pixel,
                    shifts[:, end],
                    near,
                    True,
                    packed,
                    buffers,
                    after,
                )
            _interpolate(
                before, after, np.float32(n - start) / np.float32(max(end - start, 1)), scores
            )
            _add_sources(
                own, lines, infinity_from_pixel, shifts[:, n], near, False, packed, buffers, scores
            )
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
            cost = (
                _WORST * scores[row, 0, column] / max(seen, _LEAST_SEEN)
                if seen > _ZERO
                else _UNSEEN
            )
            costs[row, column] = np.uint8(cost) + prior


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
            add_band(own, lines, infinity_from_pixel[s], shifts[s], packed[s], buffers, scores)
