"""Background pixels against a slow search along each row and column."""

import numpy as np
import pytest

from geovp_classic.geometry.occlusion import background_pixels
from geovp_classic.types import BoolArray, FloatArray


def slow_row(known: BoolArray, depth: FloatArray) -> list[int]:
    """Return the column [W] that each pixel of one row is copied from."""
    columns = []
    for column in range(len(known)):
        candidates = np.flatnonzero(known)
        sides = [candidates[candidates <= column][-1:], candidates[candidates >= column][:1]]
        choices = [int(side[0]) for side in sides if len(side)] or [column]
        # Of equally far and near ones max returns the first: the left one.
        columns.append(max(choices, key=lambda other: (depth[other], -abs(other - column))))
    return columns


@pytest.mark.parametrize("fraction", [0.0, 0.02, 0.4, 1.0])
def test_pixels_match_a_slow_search(fraction: float) -> None:
    rng = np.random.default_rng(0)
    known = rng.random((40, 30)) < np.linspace(0, fraction, 40)[:, None]
    depth = np.where(known, rng.integers(1, 4, known.shape), 0).astype(np.float32)
    expected = np.array(
        [[30 * row + c for c in slow_row(known[row], depth[row])] for row in range(40)]
    )
    rows = known.any(axis=1)
    row_depth = depth.ravel()[expected]
    for column in range(30):
        expected[:, column] = expected[slow_row(rows, row_depth[:, column]), column]
    np.testing.assert_array_equal(background_pixels(known, depth), expected)


def test_infinity_is_the_farthest() -> None:
    known = np.array([[True, False, False, True]])
    assert background_pixels(known, np.array([[np.inf, 0, 0, 9.0]])).tolist() == [[0, 0, 0, 3]]
