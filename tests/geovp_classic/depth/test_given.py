from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geovp_classic.depth.given import Given
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.types import Context, Intrinsics, Trajectory

PAST = Trajectory(np.tile(np.eye(4), (2, 1, 1)), np.array([0.0, 0.1]), is_metric=True)


@pytest.fixture
def context() -> Context:
    camera = Intrinsics(10.0, 10.0, 1.0, 0.0, 3, 1)
    depths = np.array([[[4.0, 0.0, np.inf]], [[0.5, 10.0, 0.0]]], dtype=np.float32)
    return Context(
        np.zeros((2, 1, 3, 3), np.uint8), np.array([0.0, 0.1, 0.2]), camera, past_depths=depths
    )


def test_it_inverts_and_trusts_all_but_the_unknown(context: Context) -> None:
    """Unknown pixels have the depth of their farther neighbour."""
    inverse_depths, confidence = Given().inverse_depths(context.only(Given().needs), PAST)
    np.testing.assert_allclose(inverse_depths, [[[0.25, 0.0, 0.0]], [[2.0, 0.1, 0.1]]])
    np.testing.assert_array_equal(
        confidence, [[[1, 0, 1]], [[1, 1, 0]]]
    )  # 0 = infinitely far is known of the sky


def test_sky_that_touches_a_surface_has_its_depth(context: Context) -> None:
    depths = np.full((2, 4, 5), np.inf, np.float32)
    depths[:, 2:, :2] = 4.0
    inverse_depths, _ = Given().inverse_depths(replace(context, past_depths=depths), PAST)
    expected = np.zeros((4, 5))
    expected[1:, :3] = 0.25
    np.testing.assert_array_equal(inverse_depths, [expected, expected])


def test_it_says_what_it_lacks(context: Context) -> None:
    with pytest.raises(Incompatible, match="the clip has none"):
        Given().inverse_depths(replace(context, past_depths=None), PAST)
    with pytest.raises(
        Incompatible,
        match="recorded depth is in metres, the poses are not: give the odometry a scale",
    ):
        Given().inverse_depths(context, replace(PAST, is_metric=False))


@pytest.mark.parametrize("wrong", [-1.0, np.nan])
def test_impossible_depths_are_refused(context: Context, wrong: float) -> None:
    depths = context.past_depths.copy()
    depths[0, 0, 0] = wrong
    with pytest.raises(BadData, match="write 0 where it is unknown"):
        Given().inverse_depths(replace(context, past_depths=depths), PAST)
