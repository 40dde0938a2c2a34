import numpy as np
import pytest

from geovp_classic.layers.graph_cut import MAX_PIXELS, segment
from geovp_classic.types import BoolArray, ByteArray


def disc(side: int) -> BoolArray:
    """A disc in the middle of a square image, of half its width."""
    row, column = np.mgrid[:side, :side] - (side - 1) / 2
    return np.hypot(row, column) < side / 4


def shown(inside: BoolArray) -> ByteArray:
    return np.where(inside, 200, 100).astype(np.uint8)


def test_without_an_outline_each_pixel_decides_for_itself() -> None:
    cost = np.random.default_rng(0).normal(0, 5, (20, 30)).astype(np.float32)
    flat = np.full((20, 30), 128, np.uint8)
    decided = np.abs(cost) > 0.1  # the flow is integer, in tenths
    np.testing.assert_array_equal(segment(cost, flat, 0.0, 10.0)[decided], (cost < 0)[decided])


@pytest.mark.parametrize("side", [40, 2 * int(MAX_PIXELS**0.5)])
def test_evidence_at_the_middle_spreads_to_the_edges_of_the_image(side: int) -> None:
    """Without an edge there, the outline shrinks to the evidence."""
    truth = disc(side)
    cost = np.full((side, side), 0.5, np.float32)
    middle = slice(side // 2 - side // 10, side // 2 + side // 10)
    cost[middle, middle] = -20.0
    found = segment(cost, shown(truth), 40.0, 10.0)
    assert (found != truth).mean() < 0.02
    flat = np.full((side, side), 128, np.uint8)
    assert segment(cost, flat, 0.5, 10.0).sum() < 0.5 * truth.sum()


def test_without_evidence_nothing_is_inside() -> None:
    assert not segment(np.full((20, 30), 0.5, np.float32), shown(disc(30)[:20]), 40, 10).any()
