"""The road as a plane in inverse depth."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geovp_classic.geometry import ground_plane
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(100.0, 110.0, 60.0, 45.0, 120, 96)


def _street(height: float, pitch_rad: float, roll_rad: float) -> tuple[ground_plane.GroundPlane, FloatArray]:
    normal = np.array([np.sin(roll_rad), np.cos(pitch_rad) * np.cos(roll_rad), np.sin(pitch_rad) * np.cos(roll_rad)])
    plane = ground_plane.GroundPlane(normal, height)
    return plane, np.maximum(plane.inverse_depth(CAMERA), 0.02 / height)  # and a wall far away


def test_inverse_depth_of_level_ground() -> None:
    # the row 55 px below the centre looks down by 55 / 110 per metre ahead: 1.5 m below is 3 m ahead
    level = ground_plane.GroundPlane(np.array([0.0, 1.0, 0.0]), 1.5)
    assert level.inverse_depth(CAMERA)[45 + 44, 7] == pytest.approx(44 / 110 / 1.5)
    assert (level.inverse_depth(CAMERA)[:45] < 0).all()


@settings(max_examples=15, deadline=None)
@given(st.floats(0.01, 50), st.floats(-0.05, 0.1), st.floats(-0.1, 0.1))
def test_the_plane_is_found_in_any_unit(height: float, pitch_rad: float, roll_rad: float) -> None:
    truth, inverse_depth = _street(height, pitch_rad, roll_rad)
    noisy = inverse_depth * np.random.default_rng(0).normal(1, 0.01, inverse_depth.shape)
    noisy[60:, :40] *= 2.0  # a parked car
    found = ground_plane.fit_ground(noisy, CAMERA)
    assert found is not None
    assert found.height == pytest.approx(height, rel=0.02)
    np.testing.assert_allclose(found.normal, truth.normal, atol=0.02)


def test_no_plane_in_noise_or_in_a_wall() -> None:
    noise = np.random.default_rng(0).uniform(0.01, 0.5, (96, 120))
    assert ground_plane.fit_ground(noise, CAMERA) is None
    assert ground_plane.fit_ground(np.full((96, 120), 0.1), CAMERA) is None
    assert ground_plane.fit_ground(np.zeros((96, 120)), CAMERA) is None


def test_only_what_lies_below_is_lifted_and_only_where_allowed() -> None:
    plane, inverse_depth = _street(1.5, 0.0, 0.0)
    found, allowed = inverse_depth.copy(), np.ones(inverse_depth.shape, dtype=bool)
    found[80, :30] *= 0.5  # below the road
    found[80, 60:90] *= 1.5  # a thing on it
    allowed[80, 10:20] = False
    lifted = ground_plane.clamp_to_ground(found, plane, CAMERA, allowed)
    np.testing.assert_allclose(lifted[80, :10], inverse_depth[80, :10])
    np.testing.assert_array_equal(lifted[80, 10:20], found[80, 10:20])
    np.testing.assert_array_equal(lifted[80, 60:90], found[80, 60:90])


def test_a_road_is_surely_a_plane_near_by_and_ever_less_farther_away() -> None:
    level = ground_plane.GroundPlane(np.array([0.0, 1.0, 0.0]), 1.5)
    confidence = level.confidence(1 / (1.5 * np.array([0.5, 4.0, 8.0, 16.0, -3.0])))  # distances in camera heights
    np.testing.assert_allclose(confidence, [1, 1, 1 / 4, 1 / 16, 0])


def test_what_hangs_low_over_the_road_is_told_from_what_stands_on_it_and_from_what_hangs_high() -> None:
    plane, inverse_depth = _street(1.5, 0.0, 0.0)
    islands = np.zeros(inverse_depth.shape, dtype=bool)
    hanging, standing, high = np.s_[50:58, 10:30], np.s_[50:78, 40:60], np.s_[5:15, 80:100]
    for place, depth in ((hanging, 4.0), (standing, 5.0), (high, 6.0)):
        inverse_depth[place], islands[place] = 1 / depth, True  # hanging: 1.0 to 1.3 m above the road
    found = ground_plane.floating_mask(inverse_depth, plane, CAMERA, islands)
    assert found[hanging].all()
    assert found.sum() == found[hanging].sum()
    assert not ground_plane.floating_mask(inverse_depth, plane, CAMERA, np.zeros_like(islands)).any()
