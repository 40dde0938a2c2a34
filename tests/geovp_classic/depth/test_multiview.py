"""Depth of a street that can be worked out on paper, from its pictures and poses."""

from collections.abc import Callable

import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.depth.multiview import Multiview
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, FloatArray

Observe = Callable[..., tuple]


def _drive(num: int = 6, step: float = 0.8, yaw_rad: float = 0.0) -> FloatArray:
    return se3.exp(np.arange(num)[:, None] * np.array([0, 0, step, 0, yaw_rad, 0]))


def _away_from_epipole(shape: tuple[int, int]) -> BoolArray:
    v, u = np.mgrid[: shape[0], : shape[1]]
    return np.hypot(u - 63.5, v - 55) > 24


def test_depth_of_a_street_seen_while_driving(observe: Observe) -> None:
    context, past, truth = observe(_drive())
    inverse_depths, confidence = Multiview().inverse_depths(context, past)
    relative = np.abs(inverse_depths[-1] / truth[-1] - 1)[_away_from_epipole(truth[-1].shape)]
    assert np.median(relative) < 0.02
    assert (relative < 0.25).mean() > 0.93
    assert confidence.min() >= 0
    assert confidence.max() <= 1


def test_only_the_wanted_frames_are_known(observe: Observe) -> None:
    context, past, truth = observe(_drive())
    inverse_depths, confidence = Multiview(frames=(0, -2)).inverse_depths(context, past)
    assert [bool(c.any()) for c in confidence] == [True, False, False, False, True, False]
    assert np.median(np.abs(inverse_depths[4] / truth[4] - 1)) < 0.05


def test_the_unit_of_the_poses_is_the_unit_of_the_depth(observe: Observe) -> None:
    context, past, _ = observe(_drive())
    in_metres, confidence = Multiview().inverse_depths(context, past)
    _, in_feet, _ = observe(_drive(), unit_m=0.3048)
    per_foot, same_confidence = Multiview().inverse_depths(context, in_feet)
    np.testing.assert_allclose(per_foot, 0.3048 * in_metres, rtol=0.01, atol=1e-4)
    np.testing.assert_allclose(same_confidence, confidence, atol=0.02)


def test_settings_are_checked_and_described() -> None:
    built = registry.build("depth_sources", {"name": "multiview", "frames": [-1, -3]})
    assert built == Multiview(frames=(-1, -3))
    assert registry.describe(built)["frames"] == [-1, -3]
    with pytest.raises(BadData, match="at least one frame"):
        Multiview(frames=())


def test_a_frame_that_was_not_observed(observe: Observe) -> None:
    context, past, _ = observe(_drive(num=3))
    with pytest.raises(BadData, match="of 3 observed"):
        Multiview(frames=(-4,)).inverse_depths(context, past)
