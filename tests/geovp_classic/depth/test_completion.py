"""Holes in depth take the background's, islands are found by their size."""

import numpy as np
import pytest

from geovp_classic.depth import completion
from geovp_classic.types import BoolArray, FloatArray


def slow_fill(values: FloatArray, known: BoolArray) -> FloatArray:
    filled = np.where(known, values, np.nan)
    for _ in range(2):  # rows, then columns, turned back by the second turn
        before = filled.copy()
        for row, column in np.argwhere(np.isnan(before)):
            beside = [
                line[np.isfinite(line)]
                for line in (before[row, :column][::-1], before[row, column:])
            ]
            nearest = [line[0] for line in beside if len(line)]
            filled[row, column] = min(nearest) if nearest else np.nan
        filled = filled.T
    return np.nan_to_num(filled)


@pytest.mark.parametrize("share", [0.0, 0.02, 0.2, 0.7, 1.0])
def test_gaps_are_filled_as_the_slow_twin_says(share: float) -> None:
    rng = np.random.default_rng(int(100 * share))
    values = rng.uniform(size=(13, 17)).astype(np.float32)
    known = rng.uniform(size=values.shape) < share
    before = values.copy()
    np.testing.assert_array_equal(
        completion.fill_from_background(values, known), slow_fill(values, known)
    )
    np.testing.assert_array_equal(values, before)


def test_islands_are_found_by_their_size() -> None:
    levels = np.full((20, 20), 5.0, np.float32)
    levels[2:4, 2:4] = 15.0  # 4 px
    levels[10:15, 10:15] = 15.0  # 25 px
    levels[0, 10:] = 6.5  # a step of 1.5 is a slope
    islands = completion.find_islands(levels, 10 / 400, 2.0)
    assert islands[2:4, 2:4].all()
    assert islands.sum() == 4


def test_the_upper_part_of_a_region_reaches_the_upper_border() -> None:
    is_region = np.zeros((40, 40), bool)
    is_region[:20, 5:15] = True
    is_region[20:30, 8:11] = True  # three pixels wide: not a part of it
    is_region[30:, 20:] = True
    expected = np.zeros_like(is_region)
    expected[:20, 5:15] = True
    np.testing.assert_array_equal(completion.upper_part(is_region), expected)
