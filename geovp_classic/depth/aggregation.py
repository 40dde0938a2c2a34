"""Semi-global aggregation of noisy matching costs (Hirschmueller 2008) along eight directions.

Neighbouring pixels may differ by one plane at a small cost and by more at a large one, which is
lower across edges of the image.
"""

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.depth.matching import CostArray
from geovp_classic.parallel import parallel_map
from geovp_classic.types import ByteArray, FloatArray

SumArray = npt.NDArray[np.uint16]
PathArray = npt.NDArray[np.int16]

# One pass goes down the image and one goes up. Each follows four directions: from the pixel before
# in the row and from three in the row before, as (du, dv) of the downward pass.
DIRECTIONS = ((-1, 0), (-1, -1), (0, -1), (1, -1))
ROWS_PER_TASK = 32  # of a thread
INFINITE = np.int16(2**14)  # larger than any path cost


@dataclass(frozen=True)
class SemiGlobalAggregation:
    """Costs of depth differences between neighbours, next to matching costs from 0 to 255."""

    # Of a difference of one plane. Set by hand, low: planes are a fraction of a pixel apart, and
    # slanted surfaces like the road cross many.
    small_step_cost: int = 5
    # Of a larger difference, where the image is uniform. Set by hand, below the range of one cost:
    # it takes the evidence of two pixels or so.
    large_step_cost: float = 100.0
    # Difference of the grey values 0..255 of two neighbours that halves the cost of a large step.
    # Set by hand, about ten times the noise of a camera.
    edge_contrast: float = 20.0
    # Planes on either side of the winner that are not its rivals: the costs of a surface fall to
    # their minimum over some planes.
    num_neighbours: int = 2

    def aggregate(
        self,
        costs: CostArray,  # [H, W, N]
        image: ByteArray,  # [H, W] grey
    ) -> SumArray:
        """Return the path costs [H, W, N], summed over all eight directions (eq. 14)."""

        def follow(is_upward: bool) -> SumArray:
            # The upward pass is the downward one on an image turned by 180 degrees.
            turned = image[::-1, ::-1] if is_upward else image
            large_steps = self._large_steps(turned)
            sums = np.empty(costs.shape, np.uint16)
            _follow(costs, is_upward, self.small_step_cost, large_steps, sums)
            return sums

        downward, upward = parallel_map(follow, (False, True))
        return np.add(downward, upward, out=downward)

    def winners(
        self,
        sums: SumArray,  # [H, W, N]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the best plane [H, W], refined by a parabola, and its leads [H, W].

        They are those over its rivals and over the first plane, in costs of one direction.
        """
        levels, lead, lead_over_first = np.empty((3, *sums.shape[:2]), np.float32)

        def judge(first: int) -> None:
            rows = slice(first, first + ROWS_PER_TASK)
            pixels = sums[rows].reshape(-1, sums.shape[-1])
            written = [each[rows].ravel() for each in (levels, lead, lead_over_first)]
            _judge(pixels, self.num_neighbours, *written)

        parallel_map(judge, range(0, len(sums), ROWS_PER_TASK))
        num_directions = 2 * len(DIRECTIONS)
        return levels, lead / num_directions, lead_over_first / num_directions

    def _large_steps(self, image: ByteArray) -> PathArray:
        """Return the costs [4, H, W] of large steps from the neighbour in each direction."""
        grey = image.astype(np.float32)
        costs = []
        for du, dv in DIRECTIONS:
            neighbour = np.roll(grey, (-dv, -du), axis=(0, 1))
            edge = np.abs(grey - neighbour) / self.edge_contrast
            costs.append(np.maximum(self.large_step_cost / (1 + edge), self.small_step_cost))
        return np.rint(costs).astype(np.int16)


@numba.njit(nogil=True, cache=True)
def _judge(
    sums: SumArray,  # [M, N]
    num_neighbours: int,
    levels: FloatArray,  # [M], written
    lead: FloatArray,  # [M], written
    lead_over_first: FloatArray,  # [M], written
) -> None:
    """Find the best plane of each pixel and its leads over rivals and over the first plane."""
    worst = np.uint16(2**16 - 1)
    num_planes = sums.shape[1]
    for pixel in range(len(sums)):
        # The first plane with the lowest sum wins.
        total = sums[pixel]
        lowest = worst
        for n in range(num_planes):
            lowest = min(lowest, total[n])
        best = 0
        while total[best] != lowest:
            best += 1
        # Its lead is over the best plane that is not next to it.
        rival = worst
        for n in range(best - num_neighbours):
            rival = min(rival, total[n])
        for n in range(best + num_neighbours + 1, num_planes):
            rival = min(rival, total[n])
        lead[pixel] = rival - lowest
        lead_over_first[pixel] = total[0] - lowest
        # The minimum of the parabola through the winner and its neighbours.
        levels[pixel] = best
        if 0 < best < num_planes - 1:
            before = np.float32(total[best - 1])
            after = np.float32(total[best + 1])
            curvature = before + after - 2 * np.float32(lowest)
            offset = (before - after) / (2 * max(curvature, np.float32(1)))
            levels[pixel] += offset


@numba.njit(nogil=True, cache=True)
def _follow(
    costs: CostArray,  # [H, W, N]
    is_upward: bool,
    small_step: int,
    large_steps: PathArray,  # [4, H, W], in the order of the pass
    sums: SumArray,  # [H, W, N], written
) -> None:
    """Sum the costs of the four paths of one pass.

    Paths have a margin of one plane on either side, which is never the best one, and end with
    their lowest cost.
    """
    height, width, num_planes = costs.shape
    length = num_planes + 3
    start = np.zeros(length, np.int16)  # of a path that begins at the border
    # Paths to the last pixel and this one, and to the last row and this one.
    along_row = np.full((2, length), INFINITE)
    down = np.full((2, 3, width, length), INFINITE)
    for i in range(height):
        last_row = down[(i + 1) % 2]
        this_row = down[i % 2]
        for j in range(width):
            # The upward pass reads costs from the last pixel to the first.
            row = height - 1 - i if is_upward else i
            column = width - 1 - j if is_upward else j
            cost = costs[row, column]
            # The path from the pixel before, and those from three pixels of the row before.
            previous = along_row[(j + 1) % 2] if j > 0 else start
            horizontal = along_row[j % 2]
            _extend(
                previous,
                cost,
                np.int16(small_step),
                large_steps[0, i, j],
                horizontal,
            )
            for d in range(3):
                k = j + d - 1
                is_inside = i > 0 and 0 <= k < width
                previous = last_row[d, k] if is_inside else start
                large_step = large_steps[d + 1, i, j]
                _extend(
                    previous,
                    cost,
                    np.int16(small_step),
                    large_step,
                    this_row[d, j],
                )
            # The sum of the four directions, without the margins.
            left = this_row[0, j]
            vertical = this_row[1, j]
            right = this_row[2, j]
            total = sums[row, column]
            for n in range(num_planes):
                path_sum = horizontal[n + 1] + left[n + 1] + vertical[n + 1] + right[n + 1]
                total[n] = np.uint16(path_sum)


@numba.njit(nogil=True, cache=True)
def _extend(
    previous: PathArray,  # [N + 3]
    cost: CostArray,  # [N]
    small_step: np.int16,
    large_step: np.int16,
    path: PathArray,  # [N + 3], written
) -> None:
    """Extend a path by one pixel (Hirschmueller 2008, equation 13).

    Every sum is cut to 16 bits: numba would compute it in 64.
    """
    lowest = previous[len(cost) + 2]
    new_lowest = INFINITE
    jump = np.int16(lowest + large_step)
    for n in range(len(cost)):  # plane n has index n + 1 in paths, which have a margin
        step = np.int16(min(previous[n], previous[n + 2]) + small_step)
        best = np.int16(min(min(previous[n + 1], jump), step) - lowest)
        value = np.int16(best + cost[n])
        path[n + 1] = value
        new_lowest = min(new_lowest, value)
    path[len(cost) + 2] = new_lowest
