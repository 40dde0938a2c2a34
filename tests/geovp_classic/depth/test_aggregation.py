"""Semi-global aggregation against a slow implementation of its definition."""

import numpy as np
import pytest

from geovp_classic.depth.aggregation import SemiGlobalAggregation
from geovp_classic.types import FloatArray

SMALL, LARGE, CONTRAST = 5, 60.0, 10.0
AGGREGATION = SemiGlobalAggregation(SMALL, LARGE, CONTRAST)


def path_costs(costs: FloatArray, image: FloatArray, du: int, dv: int) -> FloatArray:
    """Return the costs of Hirschmueller 2008, equation 13, from the pixel at (du, dv)."""
    height, width, num = costs.shape
    path = np.zeros(costs.shape)
    rows = range(height) if dv <= 0 else range(height - 1, -1, -1)
    columns = range(width) if du <= 0 else range(width - 1, -1, -1)
    for row in rows:
        for column in columns:
            y, x = row + dv, column + du
            path[row, column] = costs[row, column]
            if 0 <= y < height and 0 <= x < width:
                contrast = abs(float(image[row, column]) - float(image[y, x]))
                large = round(max(SMALL, LARGE / (1 + contrast / CONTRAST)))
                before = path[y, x]
                steps = np.minimum(np.abs(np.subtract.outer(np.arange(num), np.arange(num))), 2)
                options = before + np.array([0, SMALL, large])[steps]
                path[row, column] += options.min(axis=1) - before.min()
    return path


def test_sums_are_those_of_eight_paths() -> None:
    rng = np.random.default_rng(5)
    costs = rng.integers(0, 256, (7, 9, 6)).astype(np.uint8)
    image = rng.integers(0, 60, (7, 9)).astype(np.uint8)
    directions = [(du, dv) for du in (-1, 0, 1) for dv in (-1, 0, 1) if (du, dv) != (0, 0)]
    expected = sum(path_costs(costs, image, du, dv) for du, dv in directions)
    np.testing.assert_allclose(AGGREGATION.aggregate(costs, image), expected, atol=1)


def test_the_winner_lies_between_planes_and_leads_over_rivals() -> None:
    # The lowest point of a parabola through 30, 10, 20 is (30 - 20) / (2 (20 + 10)) = 1/6 above the
    # second plane. Planes up to two away are no rivals: the best rival is the fifth, 58.
    sums = np.array([[[30, 10, 20, 21, 58, 74]]], np.uint16)
    best, lead, lead_over_first = AGGREGATION.winners(sums)
    assert best[0, 0] == pytest.approx(1 + 1 / 6)
    assert lead[0, 0] == pytest.approx((58 - 10) / 8)  # of eight directions
    assert lead_over_first[0, 0] == pytest.approx((30 - 10) / 8)


def test_the_outermost_planes_win_without_a_parabola() -> None:
    sums = np.array([[[1, 5, 9, 9, 9, 9], [9, 9, 9, 9, 5, 1]]], np.uint16)
    np.testing.assert_allclose(AGGREGATION.winners(sums)[0], [[0, 5]])
