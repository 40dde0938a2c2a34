"""Smooth depth out of noisy matching costs: semi-global aggregation (Hirschmueller 2008) along eight directions.

Neighbouring pixels may differ by one hypothesis at a small price and by more at a large one, which is lower across
edges of the image.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.depth.matching import CostArray
from geovp_classic.types import FloatArray

SumArray = npt.NDArray[np.uint16]

# One pass goes down the rows and one up. Each follows four directions: from the neighbour beside, as (du, dv) of the
# downward pass, and from the three in the row before.
FROM = ((-1, 0), (-1, -1), (0, -1), (1, -1))
NEIGHBOURS = 2  # hypotheses on either side of the winner that do not count as rivals
_FAR_OFF = np.float32(1e9)
_HALF = np.float32(0.5)
_PER_PATH = np.float32(1 / (2 * len(FROM)))


def aggregate(
    costs: CostArray,  # [H, W, N]
    image: FloatArray,  # [H, W] float32 grey 0..255
    small_step: float,
    large_step: float,
    edge_contrast: float,
) -> SumArray:
    """Path costs [2, H, W, N] summed over the directions of the downward and of the upward pass; add the two.

    A step between neighbours costs `small_step` for one hypothesis and `large_step` / (1 + contrast / `edge_contrast`)
    for more, where contrast is the difference of their grey values.
    """
    # The upward pass is the downward one on an image turned by 180 degrees.
    turned = np.ascontiguousarray(image[::-1, ::-1])
    steps = np.stack([_large_steps(one, small_step, large_step, edge_contrast) for one in (image, turned)])
    sums: SumArray = _passes(costs, np.float32(small_step), steps)
    return sums


def winners(
    sums: SumArray,  # [2, H, W, N]
    inverse_depths: FloatArray,  # [N], increasing
) -> tuple[FloatArray, FloatArray]:
    """The best inverse depth [H, W], between hypotheses by a parabola, and its lead [H, W] over all rivals.

    The lead is what the path costs (one direction's share, 255 for windows that don't correlate) of the best
    hypothesis that is no neighbour of the winner are above the winner's; 0 when there is none.
    """
    best: tuple[FloatArray, FloatArray] = _winners(sums, inverse_depths.astype(np.float32))
    return best


def excess(
    sums: SumArray,  # [2, H, W, N]
    inverse_depths: FloatArray,  # [N], increasing
    map_to_judge: FloatArray,  # [H, W] inverse depth
) -> FloatArray:
    """How much more than the winner [H, W] the hypothesis next to a given inverse depth costs, per direction."""
    index = np.interp(map_to_judge, inverse_depths, np.arange(len(inverse_depths)))
    below = np.clip(index.astype(np.int64), 0, len(inverse_depths) - 2)
    judged: FloatArray = _excess(sums, below)
    return judged


def _large_steps(image: FloatArray, small_step: float, large_step: float, edge_contrast: float) -> FloatArray:
    """[4, H, W]: the price of a jump from the neighbour in each direction of FROM (wrapped around where none is)."""
    steps = np.empty((len(FROM), *image.shape), np.float32)
    for price, (du, dv) in zip(steps, FROM, strict=True):
        contrast = np.abs(image - np.roll(image, (-dv, -du), axis=(0, 1)))
        np.maximum(small_step, large_step / (1 + contrast / edge_contrast), out=price)
    return steps


@numba.njit(parallel=True, fastmath=True, cache=True)
def _passes(costs: CostArray, small_step: np.float32, large_steps: FloatArray) -> SumArray:
    height, width, num = costs.shape
    sums = np.empty((2, height, width, num), np.uint16)
    for turned in numba.prange(2):
        # A path has a margin of one hypothesis on either side, which is never chosen, and its minimum at the end.
        start = np.full(num + 3, _FAR_OFF, np.float32)
        start[1:] = 0.0  # a path that starts here has cost nothing so far
        before = np.full((3, width, num + 3), _FAR_OFF, np.float32)
        here = np.full((3, width, num + 3), _FAR_OFF, np.float32)
        buffers = np.full((2, num + 3), _FAR_OFF, np.float32)
        for i in range(height):
            for j in range(width):
                row, column = (i, j) if turned == 0 else (height - 1 - i, width - 1 - j)
                cost, steps = costs[row, column], large_steps[turned, :, i, j]
                along = buffers[j % 2]
                _extend(start if j == 0 else buffers[(j + 1) % 2], cost, small_step, steps[0], along)
                for d in range(3):
                    k = j + d - 1
                    previous = start if i == 0 or k < 0 or k >= width else before[d, k]
                    _extend(previous, cost, small_step, steps[d + 1], here[d, j])
                left, down, right = here[0, j], here[1, j], here[2, j]
                for n in range(num):
                    path = along[n + 1] + left[n + 1] + down[n + 1] + right[n + 1]
                    sums[turned, row, column, n] = np.uint16(path + _HALF)
            before, here = here, before
    return sums


@numba.njit(fastmath=True, cache=True)
def _extend(
    previous: FloatArray,  # [N + 3]
    cost: CostArray,  # [N]
    small_step: np.float32,
    large_step: np.float32,
    path: FloatArray,  # [N + 3], written
) -> None:
    """Equation 13 of Hirschmueller 2008. The compiler vectorises the loop because it holds no running minimum."""
    num = len(cost)
    least = previous[num + 2]
    jump = least + large_step
    for n in range(num):
        step = min(previous[n], previous[n + 2]) + small_step
        path[n + 1] = np.float32(cost[n]) + min(min(previous[n + 1], jump), step) - least
    path[num + 2] = _smallest(path[1 : num + 1])


@numba.njit(fastmath=True, cache=True)
def _smallest(values: FloatArray) -> np.float32:
    """The smallest of [N], by quarters, so that comparisons run in parallel."""
    a, b, c, d = _FAR_OFF, _FAR_OFF, _FAR_OFF, _FAR_OFF
    quarter = len(values) // 4
    for n in range(quarter):
        a, b = min(a, values[n]), min(b, values[n + quarter])
        c, d = min(c, values[n + 2 * quarter]), min(d, values[n + 3 * quarter])
    for n in range(4 * quarter, len(values)):
        a = min(a, values[n])
    return min(min(a, b), min(c, d))


@numba.njit(parallel=True, cache=True)
def _winners(sums: SumArray, inverse_depths: FloatArray) -> tuple[FloatArray, FloatArray]:
    _, height, width, num = sums.shape
    best = np.empty((height, width), np.float32)
    lead = np.zeros((height, width), np.float32)
    for row in numba.prange(height):
        total = np.empty(num, np.int32)
        for column in range(width):
            n = _total(sums[:, row, column], total)
            rival = _FAR_OFF
            for k in range(num):
                if abs(k - n) > NEIGHBOURS:
                    rival = min(rival, np.float32(total[k]))
            if rival < _FAR_OFF:
                lead[row, column] = (rival - np.float32(total[n])) * _PER_PATH
            best[row, column] = inverse_depths[n]
            if 0 < n < num - 1 and total[n - 1] + total[n + 1] > 2 * total[n]:
                bend = np.float32(total[n - 1] + total[n + 1] - 2 * total[n])
                offset = _HALF * np.float32(total[n - 1] - total[n + 1]) / bend
                other = n + 1 if offset > 0 else n - 1
                best[row, column] += abs(offset) * (inverse_depths[other] - inverse_depths[n])
    return best, lead


@numba.njit(cache=True)
def _total(sums: SumArray, total: npt.NDArray[np.int32]) -> int:
    """Both passes' sums [N], written, and the index of the smallest."""
    n = 0
    for k in range(len(total)):
        total[k] = np.int32(sums[0, k]) + np.int32(sums[1, k])
        if total[k] < total[n]:
            n = k
    return n


@numba.njit(parallel=True, cache=True)
def _excess(sums: SumArray, below: npt.NDArray[np.int64]) -> FloatArray:
    height, width = below.shape
    excess = np.empty((height, width), np.float32)
    for row in numba.prange(height):
        total = np.empty(sums.shape[3], np.int32)
        for column in range(width):
            n, k = _total(sums[:, row, column], total), below[row, column]
            excess[row, column] = np.float32(min(total[k], total[k + 1]) - total[n]) * _PER_PATH
    return excess
