"""Ground prior: surfaces below the road are lifted, and low floating islands are found."""

import numpy as np
import pytest

from geovp_classic.depth.ground_prior import GroundPrior
from geovp_classic.geometry.ground_plane import GroundPlane
from geovp_classic.types import Intrinsics

CAMERA = Intrinsics(100.0, 110.0, 60.0, 45.0, 120, 96)
LEVEL = GroundPlane(np.array([0.0, 1.0, 0.0]), 1.0)
PLANES = np.linspace(0, 1, 11)


def test_surfaces_below_the_road_are_lifted_where_images_permit_it() -> None:
    road = LEVEL.inverse_depth(CAMERA)  # row 89: 0.4, on the fifth plane
    inverse_depth = np.maximum(road, 0)
    inverse_depth[89, :40] = 0.2  # below the road
    inverse_depth[89, 60:90] = 0.6  # an object on it
    sums = np.full((96, 120, 11), 8 * 10, np.uint16)
    sums[89, :40, 2] = 0  # the road costs 10 more than the best plane,
    sums[89, 20:40, 3:6] = 8 * 50  # or 50 more
    lifted = GroundPrior().lift(inverse_depth, sums, PLANES, LEVEL, CAMERA)
    np.testing.assert_allclose(lifted[89, :20], 0.4, rtol=1e-6)
    np.testing.assert_array_equal(lifted[89, 20:], inverse_depth[89, 20:])


def test_the_road_may_cost_less_farther_away() -> None:
    # At 8 camera heights, twice the range of a level road, the allowed cost is a quarter: 10.
    row = 45 + 14  # sees the road at 110 / 14 = 7.9 camera heights
    sums = np.zeros((96, 120, 11), np.uint16)
    sums[:, :60, 1:] = 8 * 9
    sums[:, 60:, 1:] = 8 * 11
    lifted = GroundPrior().lift(np.zeros((96, 120)), sums, PLANES, LEVEL, CAMERA)
    assert lifted[row, :60].all()
    assert not lifted[row, 60:].any()


@pytest.mark.parametrize(
    ("lowest", "highest", "is_floating"),
    [(0.25, 1.4, True), (0.1, 1.4, False), (0.35, 1.55, True), (0.35, 1.75, False)],
)
def test_islands_float_low_over_the_road(lowest: float, highest: float, is_floating: bool) -> None:
    # Between 0.3 and 1.5 camera heights, for all but a tenth at either end. At a depth of 4, the
    # row d below the centre is 1 - 4 d / 110 above the ground.
    top, bottom = 45 + np.rint(110 * (1 - np.array([highest, lowest])) / 4.0).astype(int)
    islands = np.zeros((96, 120), bool)
    islands[top : bottom + 1, 50:60] = True
    islands[10:20, 100:110] = True  # far above
    floating = GroundPrior().floating(np.where(islands, 1 / 4, 0.0), islands, LEVEL, CAMERA)
    assert floating[:, 50:60].any() == is_floating
    assert not floating[10:20, 100:110].any()
