"""Outlines: the whole thing from a part of it, nothing where its motion explains nothing, no gaps
inside.
"""

from typing import Any

import numpy as np
import pytest

from geovp_classic.dynamic_objects import segmentation
from geovp_classic.types import BoolArray

STEPS = (1, 2, 3)


def half_of(mask: BoolArray) -> BoolArray:
    """The lower half of a mask's rows, of which only every second pixel is known."""
    rows, _ = np.nonzero(mask)
    part = mask.copy()
    part[: int(rows.mean())] = False
    part[:, ::2] = False
    return part


def test_half_of_a_car_leads_to_the_whole(
    traffic: Any, observed: segmentation.Observations
) -> None:
    mask = segmentation.segment(
        half_of(traffic.mask), 8.0, np.array([1.2, 0.0, 5.0]), STEPS, observed
    )
    assert (mask & traffic.mask).sum() / traffic.mask.sum() > 0.9  # recall
    assert (mask & traffic.mask).sum() / mask.sum() > 0.7  # precision


def test_a_motion_that_explains_nothing_has_no_outline(
    traffic: Any, observed: segmentation.Observations
) -> None:
    assert (
        segmentation.segment(
            half_of(traffic.mask), 8.0, np.array([-3.0, 0.0, -6.0]), STEPS, observed
        )
        is None
    )


def test_the_street_has_no_outline(traffic: Any, observed: segmentation.Observations) -> None:
    wall = np.zeros_like(traffic.mask)
    wall[20:30, 60:80] = True  # 24 m away and standing
    assert segmentation.segment(wall, 24.0, np.array([1.2, 0.0, 5.0]), STEPS, observed) is None


def test_an_outline_has_no_gap_in_any_row_or_column(
    traffic: Any, observed: segmentation.Observations
) -> None:
    mask = segmentation.segment(
        half_of(traffic.mask), 8.0, np.array([1.2, 0.0, 5.0]), STEPS, observed
    )
    for lines in (mask, mask.T):
        starts = (np.diff(lines.astype(int), axis=1, prepend=0) == 1).sum(axis=1)
        assert starts.max() == 1


def test_seconds_count_back_from_the_last_frame(observed: segmentation.Observations) -> None:
    assert observed.seconds(0) == 0
    assert observed.seconds(3) == pytest.approx(0.3)


def test_a_thing_looks_the_same_where_its_motion_took_it_and_nowhere_else(
    traffic: Any, observed: segmentation.Observations
) -> None:
    # Images are rounded and sampled twice, which costs some grey values; the texture's own spread
    # is 60.
    assert (
        segmentation.photometric_error(
            traffic.mask, 8.0, np.array([1.2, 0.0, 5.0]), STEPS, observed
        )
        < 8
    )
    assert (
        segmentation.photometric_error(
            traffic.mask, 8.0, np.array([1.2, 0.0, 0.0]), STEPS, observed
        )
        > 20
    )
