"""Semi-global aggregation against a slow twin, and what it is for."""

import numpy as np
import pytest

from geovp_classic.depth import aggregation
from geovp_classic.types import FloatArray

SMALL, LARGE, CONTRAST = 5, 60.0, 10.0
DIRECTIONS = [
    (-1, 0),
    (-1, -1),
    (0, -1),
    (1, -1),
    (1, 0),
    (1, 1),
    (0, 1),
    (-1, 1),
]  # (du, dv) to the pixel before


def _path_costs(costs: FloatArray, image: FloatArray, du: int, dv: int) -> FloatArray:
    """Hirschmueller 2008, equation 13, as it is written there."""
    height, width, num = costs.shape
    path = np.zeros(costs.shape)
    rows = range(height) if dv <= 0 else range(height - 1, -1, -1)
    columns = range(width) if du <= 0 else range(width - 1, -1, -1)
    for row in rows:
        for column in columns:
            y, x = row + dv, column + du
            if not (0 <= y < height and 0 <= x < width):
                path[row, column] = costs[row, column]
                continue
            large = max(SMALL, LARGE / (1 + abs(image[row, column] - image[y, x]) / CONTRAST))
            before = path[y, x]
            for n in range(num):
                options = [before[n], before.min() + large]
                options += [before[m] + SMALL for m in (n - 1, n + 1) if 0 <= m < num]
                path[row, column, n] = costs[row, column, n] + min(options) - before.min()
    return path


@pytest.fixture
def costs() -> FloatArray:
    return np.random.default_rng(5).integers(0, 256, (7, 9, 6)).astype(np.uint8)


def test_sums_equal_the_slow_twin(costs: FloatArray) -> None:
    image = np.random.default_rng(6).uniform(0, 60, (7, 9)).astype(np.float32)
    expected = sum(_path_costs(costs, image, du, dv) for du, dv in DIRECTIONS)
    sums = aggregation.aggregate(costs, image, SMALL, LARGE, CONTRAST)
    # each price of a step is rounded to a sixteenth
    np.testing.assert_allclose(sums.astype(int) / aggregation.PRECISION, expected, atol=1)


def test_one_bad_pixel_is_outvoted() -> None:
    plain = np.full((7, 9, 6), 100, np.uint8)
    plain[..., 2] = 20  # all say hypothesis 2 ...
    plain[3, 4, 2], plain[3, 4, 5] = 40, 20  # ... but one
    image = np.zeros((7, 9), np.float32)
    best, _, _ = aggregation.winners(aggregation.aggregate(plain, image, SMALL, LARGE, CONTRAST))
    np.testing.assert_allclose(best, 2, atol=0.2)


def test_the_winner_lies_between_hypotheses() -> None:
    # costs 30, 10, 20: the parabola's lowest point is (30 - 20) / (2 (20 + 10)) = 1/6 above
    # hypothesis 1
    sums = np.array([[[30, 10, 20]]], np.uint16)
    best, lead, least = aggregation.winners(sums)
    assert best[0, 0] == pytest.approx(1 + 1 / 6)
    assert least[0, 0] == 10
    assert lead[0, 0] == 0  # neighbours are no rivals


def test_the_outermost_hypotheses_win_as_they_are() -> None:
    sums = np.array([[[1, 5, 9], [9, 5, 1]]], np.uint16)
    best, _, _ = aggregation.winners(sums)
    np.testing.assert_allclose(best, [[0, 2]])


def test_the_lead_is_counted_from_the_best_rival() -> None:
    sums = np.array(
        [[[80, 0, 8, 9, 48, 64]]], np.uint16
    )  # 1 wins, 2 and 3 are its neighbours, 4 is the rival
    _, lead, _ = aggregation.winners(sums)
    assert lead[0, 0] == pytest.approx(48 / 8 / aggregation.PRECISION)  # of eight directions


def test_excess_of_a_given_depth() -> None:
    sums = np.tile(np.array([80, 0, 16, 40], np.uint16), (1, 3, 1))
    where = np.array([[True, False, True]])
    judged = aggregation.excess(sums, np.zeros((1, 3), np.uint16), np.array([0.5, 2.5]), where)
    np.testing.assert_allclose(
        judged * aggregation.PRECISION, [0, 16 / 8]
    )  # of the two next hypotheses the better one
