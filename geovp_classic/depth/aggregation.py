"""Smooth depth out of noisy matching costs: semi-global aggregation (Hirschmueller 2008) along eight directions.

Neighbouring pixels may differ by one hypothesis at a small price and by more at a large one, which is lower across
edges of the picture.
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
_FAR_OFF = np.float32(1e9)
_HALF = np.float32(0.5)


def aggregate(
    costs: CostArray,  # [H, W, N]
    picture: FloatArray,  # [H, W] float32 grey 0..255
    small_step: float,
    large_step: float,
    edge_contrast: float,
) -> SumArray:
    """Path costs [2, H, W, N] summed over the directions of the downward and of the upward pass; add the two.

    A step between neighbours costs `small_step` for one hypothesis and `large_step` / (1 + contrast / `edge_contrast`)
    for more, where contrast is the difference of their grey values.
    """
    # The upward pass is the downward one on a picture turned by 180 degrees.
    turned = np.ascontiguousarray(picture[::-1, ::-1])
    steps = np.stack([_large_steps(one, small_step, large_step, edge_contrast) for one in (picture, turned)])
    sums: SumArray = _passes(costs, np.float32(small_step), steps)
    return sums


def winners(
    sums: SumArray,  # [2, H, W, N]
    costs: CostArray,  # [H, W, N]
    inverse_depths: FloatArray,  # [N], increasing
) -> tuple[FloatArray, CostArray]:
    """The best inverse depth [H, W], between hypotheses by a parabola, and the matching cost [H, W] at the best one."""
    best: tuple[FloatArray, CostArray] = _winners(sums, costs, inverse_depths.astype(np.float32))
    return best


def _large_steps(picture: FloatArray, small_step: float, large_step: float, edge_contrast: float) -> FloatArray:
    """[4, H, W]: the price of a jump from the neighbour in each direction of FROM (wrapped around where none is)."""
    steps = np.empty((len(FROM), *picture.shape), np.float32)
    for price, (du, dv) in zip(steps, FROM, strict=True):
        contrast = np.abs(picture - np.roll(picture, (-dv, -du), axis=(0, 1)))
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
        beside = np.full((2, num + 3), _FAR_OFF, np.float32)
        for i in range(height):
            for j in range(width):
                row, column = (i, j) if turned == 0 else (height - 1 - i, width - 1 - j)
                cost, steps = costs[row, column], large_steps[turned, :, i, j]
                along = beside[j % 2]
                _extend(start if j == 0 else beside[(j + 1) % 2], cost, small_step, steps[0], along)
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
    """Equation 13 of Hirschmueller 2008."""
    num = len(cost)
    least = previous[num + 2]
    jump = least + large_step
    smallest = _FAR_OFF
    for n in range(num):
        step = min(previous[n], previous[n + 2]) + small_step
        here = np.float32(cost[n]) + min(min(previous[n + 1], jump), step) - least
        path[n + 1] = here
        smallest = min(smallest, here)
    path[num + 2] = smallest


@numba.njit(parallel=True, cache=True)
def _winners(sums: SumArray, costs: CostArray, inverse_depths: FloatArray) -> tuple[FloatArray, CostArray]:
    height, width, num = costs.shape
    best = np.empty((height, width), np.float32)
    cost_there = np.empty((height, width), np.uint8)
    for row in numba.prange(height):
        for column in range(width):
            down, up = sums[0, row, column], sums[1, row, column]
            n = 0
            for k in range(1, num):
                if np.int32(down[k]) + np.int32(up[k]) < np.int32(down[n]) + np.int32(up[n]):
                    n = k
            cost_there[row, column] = costs[row, column, n]
            best[row, column] = inverse_depths[n]
            if 0 < n < num - 1:
                least = np.float32(down[n]) + np.float32(up[n])
                nearer_0 = np.float32(down[n - 1]) + np.float32(up[n - 1]) - least
                nearer_1 = np.float32(down[n + 1]) + np.float32(up[n + 1]) - least
                if nearer_0 + nearer_1 > 0:
                    offset = _HALF * (nearer_0 - nearer_1) / (nearer_0 + nearer_1)
                    other = n + 1 if offset > 0 else n - 1
                    best[row, column] += abs(offset) * (inverse_depths[other] - inverse_depths[n])
    return best, cost_there
