"""The pixel that fills a hole against a slow twin that walks along each row and column."""

import numpy as np
import pytest

from geovp_classic.geometry.occlusion import background_pixels
from geovp_classic.types import BoolArray, FloatArray


def slow_row(known: BoolArray, depth: FloatArray) -> list[int]:
    """The column [W] that each pixel of one row names."""
    found = []
    for column in range(len(known)):
        there = np.flatnonzero(known)
        sides = [there[there <= column][-1:], there[there >= column][:1]]
        candidates = [int(side[0]) for side in sides if len(side)] or [column]
        # Of equally far and near ones max takes the first: the left one.
        found.append(max(candidates, key=lambda other: (depth[other], -abs(other - column))))
    return found


@pytest.mark.parametrize("share", [0.0, 0.02, 0.4, 1.0])
def test_every_pixel_names_what_the_slow_twin_says(share: float) -> None:
    rng = np.random.default_rng(0)
    known = rng.random((40, 30)) < np.linspace(0, share, 40)[:, None]
    depth = np.where(known, rng.integers(1, 4, known.shape), 0).astype(np.float32)
    expected = np.array(
        [[30 * row + c for c in slow_row(known[row], depth[row])] for row in range(40)]
    )
    rows, far = known.any(axis=1), depth.ravel()[expected]
    for column in range(30):
        expected[:, column] = expected[slow_row(rows, far[:, column]), column]
    np.testing.assert_array_equal(background_pixels(known, depth), expected)


def test_infinity_is_the_farthest() -> None:
    known = np.array([[True, False, False, True]])
    assert background_pixels(known, np.array([[np.inf, 0, 0, 9.0]])).tolist() == [[0, 0, 0, 3]]
