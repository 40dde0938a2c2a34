"""Smooth depth out of noisy matching costs: semi-global aggregation (Hirschmueller 2008) along
eight directions.

Neighbouring pixels may differ by one hypothesis at a small price and by more at a large one, which
is lower across edges of the image.
"""

from functools import partial

import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.depth.correlation import CostArray
from geovp_classic.parallel import parallel_map
from geovp_classic.types import BoolArray, FloatArray

SumArray = npt.NDArray[np.uint16]
PathArray = npt.NDArray[np.int16]

# One pass goes down the rows and one up. Each follows four directions: from the neighbour in the
# row, as (du, dv) of
# the downward pass, and from the three in the row before.
FROM = ((-1, 0), (-1, -1), (0, -1), (1, -1))
PRECISION = 16  # path costs are counted in sixteenths: their sums stay below 2**16
UNIT = np.float32(2 * len(FROM) * PRECISION)  # of the sums over all directions
NEIGHBOURS = 2  # hypotheses on either side of the winner that do not count as rivals
BAND_ROWS = 32  # that a thread works on at a time
_FAR_OFF, _PRECISION = np.int16(2**14), np.int16(PRECISION)


def aggregate(
    costs: CostArray,  # [H, W, N]
    image: FloatArray,  # [H, W] float32 grey 0..255
    small_step: int,
    large_step: float,
    edge_contrast: float,
    out: SumArray | None = None,  # [H, W, N], where the sums are written
) -> SumArray:
    """Path costs [H, W, N] summed over all directions, one UNIT for an average of 1.

    A step between neighbours costs `small_step` for one hypothesis and `large_step` / (1 + contrast
    / `edge_contrast`) for more, where contrast is the difference of their grey values.
    """
    height, width, num = costs.shape
    sums = np.empty((height, width, num), np.uint16) if out is None else out
    # The upward pass is the downward one on an image turned by 180 degrees.
    steps = [
        _large_steps(each, small_step, large_step, edge_contrast)
        for each in (image, image[::-1, ::-1])
    ]
    # A path has a margin of one hypothesis on either side, which is never chosen, and its minimum
    # at the end.
    rows, along = (
        np.full((2, *size, num + 3), _FAR_OFF, np.int16) for size in ((2, 3, width), (3,))
    )
    along[:, 2, 1:] = 0  # a path that starts here has cost nothing so far

    def aggregate_half(second: bool, turned: int) -> None:
        middle = height - height // 2 if turned else height // 2
        top, bottom = (middle, height) if second else (0, middle)
        price = np.int16(PRECISION * small_step)
        _pass(
            costs,
            bool(turned),
            second,
            top,
            bottom,
            price,
            steps[turned],
            rows[turned],
            along[turned],
            sums,
        )

    for second in (
        False,
        True,
    ):  # the passes meet in the middle; then each adds to what the other has left
        parallel_map(partial(aggregate_half, second), range(2))
    return sums


def winners(
    sums: SumArray,  # [H, W, N]
) -> tuple[FloatArray, FloatArray, SumArray]:
    """The best hypothesis [H, W], between whole ones by a parabola, its lead [H, W] over all
    rivals, and its sum.

    The lead is what the path costs (one direction's share, 255 for windows that don't correlate) of
    the best hypothesis that is no neighbour of the winner are above the winner's; 0 when there is
    none.
    """
    shape = sums.shape[:2]
    best, lead, least = (
        np.empty(shape, np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.uint16),
    )

    def judge(top: int) -> None:
        rows = slice(top, top + BAND_ROWS)
        _winners(sums[rows], best[rows], lead[rows], least[rows])

    parallel_map(judge, range(0, shape[0], BAND_ROWS))
    return best, lead / UNIT, least


def excess(
    sums: SumArray,  # [H, W, N]
    least: SumArray,  # [H, W], the winners' sums
    level: FloatArray,  # [M], hypotheses to judge
    where: BoolArray,  # [H, W], M of them
) -> FloatArray:
    """How much more than the winner [M] the better one of the two hypotheses next to a level costs,
    per direction.
    """
    below = np.clip(level.astype(np.int64), 0, sums.shape[2] - 2)
    rows, columns = np.nonzero(where)
    judged = np.minimum(*(sums[rows, columns, n] for n in (below, below + 1)))
    return (judged - least[where]).astype(np.float32) / UNIT


def _large_steps(
    image: FloatArray, small_step: int, large_step: float, edge_contrast: float
) -> PathArray:
    """[4, H, W]: the price of a jump from the neighbour in each direction of FROM (wrapped around
    where none is).
    """
    steps = np.empty((len(FROM), *image.shape), np.int16)
    for price, (du, dv) in zip(steps, FROM, strict=True):
        contrast = np.abs(image - np.roll(image, (-dv, -du), axis=(0, 1)))
        price[:] = np.rint(
            PRECISION * np.maximum(small_step, large_step / (1 + contrast / edge_contrast))
        )
    return steps


@numba.njit(nogil=True, cache=True)
def _pass(
    costs: CostArray,  # [H, W, N]
    turned: bool,  # by 180 degrees
    second: bool,  # the other pass has been here
    top: int,  # the first row, of the turned image
    bottom: int,  # behind the last row
    small_step: np.int16,
    large_steps: PathArray,  # [4, H, W] of the turned image
    rows: PathArray,  # [2, 3, W, N + 3], changed: the paths from the row before, of two rows
    # [3, N + 3], changed: the paths from the pixel before, of two pixels; one that starts here
    along: PathArray,
    sums: SumArray,  # [H, W, N], written or added to
) -> None:
    height, width, num = costs.shape
    start = along[2]
    for i in range(top, bottom):
        before, here = rows[(i + 1) % 2], rows[i % 2]
        for j in range(width):
            row, column = (height - 1 - i, width - 1 - j) if turned else (i, j)
            cost, horizontal = costs[row, column], along[j % 2]
            _extend(
                along[(j + 1) % 2] if j > 0 else start,
                cost,
                small_step,
                large_steps[0, i, j],
                horizontal,
            )
            for d in range(3):
                k = j + d - 1
                previous = before[d, k] if i > 0 and 0 <= k < width else start
                _extend(previous, cost, small_step, large_steps[d + 1, i, j], here[d, j])
            left, down, right, total = here[0, j], here[1, j], here[2, j], sums[row, column]
            for n in range(num):
                own = np.uint16(horizontal[n + 1] + left[n + 1] + down[n + 1] + right[n + 1])
                total[n] = np.uint16(total[n] + own) if second else own


@numba.njit(nogil=True, cache=True)
def _extend(
    previous: PathArray,  # [N + 3]
    cost: CostArray,  # [N]
    small_step: np.int16,
    large_step: np.int16,
    path: PathArray,  # [N + 3], written
) -> None:
    """Equation 13 of Hirschmueller 2008. Sums are cut to 16 bits one by one, or numba would work in
    64.
    """
    least, smallest = previous[len(cost) + 2], _FAR_OFF
    jump = np.int16(least + large_step)
    for n in range(len(cost)):
        step = np.int16(min(previous[n], previous[n + 2]) + small_step)
        value = np.int16(
            np.int16(min(min(previous[n + 1], jump), step) - least) + np.int16(_PRECISION * cost[n])
        )
        path[n + 1], smallest = value, min(smallest, value)
    path[len(cost) + 2] = smallest


@numba.njit(nogil=True, cache=True)
def _winners(
    sums: SumArray,  # [H, W, N]
    best: FloatArray,  # [H, W], written
    lead: FloatArray,  # [H, W], written, of the sums
    least: SumArray,  # [H, W], written
) -> None:
    height, width, num = sums.shape
    for row in range(height):
        for column in range(width):
            total, smallest, n = sums[row, column], np.uint16(65535), 0
            for k in range(num):
                smallest = min(smallest, total[k])
            while total[n] != smallest:
                n += 1
            rival = np.uint16(65535)
            for k in range(n - NEIGHBOURS):
                rival = min(rival, total[k])
            for k in range(n + NEIGHBOURS + 1, num):
                rival = min(rival, total[k])
            least[row, column] = smallest
            lead[row, column] = (
                np.float32(rival) - np.float32(smallest) if rival < 65535 else np.float32(0)
            )
            best[row, column] = np.float32(n)
            if 0 < n < num - 1 and total[n - 1] + total[n + 1] > 2 * smallest:
                before, after, here = (
                    np.float32(total[n - 1]),
                    np.float32(total[n + 1]),
                    np.float32(smallest),
                )
                best[row, column] += (
                    np.float32(0.5) * (before - after) / (before + after - 2 * here)
                )
