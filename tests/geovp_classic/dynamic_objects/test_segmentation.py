"""Masks: the whole object from a part of it, and none where its motion explains nothing."""

from typing import Any

import numpy as np
import pytest

from geovp_classic.dynamic_objects.posed_images import PosedImages
from geovp_classic.dynamic_objects.segmentation import MotionSegmentation
from geovp_classic.types import BoolArray, FloatArray

TRUE_VELOCITY = np.array([1.2, 0.0, 5.0])


def half_of(mask: BoolArray) -> BoolArray:
    """Return every second pixel of the lower half of a mask."""
    rows, _ = np.nonzero(mask)
    part = mask.copy()
    part[: int(rows.mean())] = False
    part[:, ::2] = False
    return part


def test_half_of_a_car_leads_to_the_whole(traffic: Any, observed: PosedImages) -> None:
    mask = MotionSegmentation().segment(half_of(traffic.mask), 8.0, TRUE_VELOCITY, observed)
    assert mask is not None
    overlap = (mask & traffic.mask).sum()
    assert overlap / traffic.mask.sum() > 0.9
    assert overlap / mask.sum() > 0.7
    for lines in (mask, mask.T):  # without gaps
        starts = (np.diff(lines.astype(int), axis=1, prepend=0) == 1).sum(axis=1)
        assert starts.max() == 1


def test_a_wrong_motion_has_no_mask(traffic: Any, observed: PosedImages) -> None:
    velocity = np.array([-3.0, 0.0, -6.0])
    evidence = half_of(traffic.mask)
    assert MotionSegmentation().segment(evidence, 8.0, velocity, observed) is None


def test_a_static_wall_has_no_mask(traffic: Any, observed: PosedImages) -> None:
    wall = np.zeros_like(traffic.mask)
    wall[20:30, 60:80] = True  # 24 m away
    assert MotionSegmentation().segment(wall, 24.0, TRUE_VELOCITY, observed) is None


@pytest.mark.parametrize(("velocity", "is_true"), [(TRUE_VELOCITY, True), ([1.2, 0, 0], False)])
def test_photometric_error_is_small_for_the_true_motion(
    traffic: Any, observed: PosedImages, velocity: FloatArray, is_true: bool
) -> None:
    # Images are rounded and sampled twice, which costs some grey values; the texture's own spread
    # is 60.
    error = MotionSegmentation().photometric_error(traffic.mask, 8.0, np.array(velocity), observed)
    assert error < 8 if is_true else error > 20
