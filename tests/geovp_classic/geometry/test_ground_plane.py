"""The ground plane in inverse depth."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geovp_classic.geometry.ground_plane import GroundFit, GroundPlane
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(100.0, 110.0, 60.0, 45.0, 120, 96)
LEVEL = GroundPlane(np.array([0.0, 1.0, 0.0]), 1.5)


def street(height: float, pitch_rad: float, roll_rad: float) -> tuple[GroundPlane, FloatArray]:
    """Return a tilted ground plane, and its inverse depth in front of a distant wall."""
    upright = np.cos(pitch_rad) * np.cos(roll_rad)
    ahead = np.sin(pitch_rad) * np.cos(roll_rad)
    plane = GroundPlane(np.array([np.sin(roll_rad), upright, ahead]), height)
    return plane, np.maximum(plane.inverse_depth(CAMERA), 0.02 / height)


def test_inverse_depth_of_level_ground() -> None:
    # The row 44 px below the centre looks down by 44 / 110 per metre: the ground, 1.5 m below.
    assert LEVEL.inverse_depth(CAMERA)[45 + 44, 7] == pytest.approx(44 / 110 / 1.5)
    assert (LEVEL.inverse_depth(CAMERA)[:45] < 0).all()


def test_ground_is_near_up_to_twenty_camera_heights() -> None:
    # The row d px below the centre sees ground at 110 / d camera heights: 20 at d = 5.5.
    is_near = LEVEL.is_near(LEVEL.inverse_depth(CAMERA))
    assert not is_near[: 45 + 6].any()
    assert is_near[45 + 6 :].all()


@settings(max_examples=15, deadline=None)
@given(st.floats(0.01, 50), st.floats(-0.05, 0.1), st.floats(-0.1, 0.1))
def test_the_plane_is_fitted_in_any_unit(height: float, pitch_rad: float, roll_rad: float) -> None:
    truth, inverse_depth = street(height, pitch_rad, roll_rad)
    rng = np.random.default_rng(0)
    noisy = inverse_depth * rng.normal(1, 0.01, inverse_depth.shape)
    noisy[60:, :40] *= 2.0  # a parked car
    noisy[:48] = rng.uniform(0, 5, (48, 120))  # the upper half does not matter
    plane = GroundFit().fit(noisy, CAMERA)
    assert plane is not None
    assert plane.height == pytest.approx(height, rel=0.02)
    np.testing.assert_allclose(plane.normal, truth.normal, atol=0.02)


def test_outliers_do_not_bend_the_plane() -> None:
    truth, inverse_depth = street(1.5, 0.03, 0.02)
    inverse_depth[48:, :40] *= 1.5  # a car
    plane = GroundFit().fit(inverse_depth, CAMERA)
    assert plane is not None
    np.testing.assert_allclose(plane.normal, truth.normal, atol=1e-4)
    assert plane.height == pytest.approx(1.5, rel=1e-4)


def test_noise_and_walls_are_not_ground() -> None:
    noise = np.random.default_rng(0).uniform(0.01, 0.5, (96, 120))
    for inverse_depth in (noise, np.full((96, 120), 0.1), np.zeros((96, 120))):
        assert GroundFit().fit(inverse_depth, CAMERA) is None


@pytest.mark.parametrize(("tilt_deg", "is_ground"), [(22.0, True), (29.0, False)])
def test_ground_is_tilted_by_at_most_26_degrees(tilt_deg: float, is_ground: bool) -> None:
    _, inverse_depth = street(1.5, 0.0, np.deg2rad(tilt_deg))  # cos 25.8 degrees = 0.9
    assert (GroundFit().fit(inverse_depth, CAMERA) is not None) == is_ground


@pytest.mark.parametrize(("columns", "is_ground"), [(36, True), (16, False)])
def test_a_fifth_of_the_lower_half_must_be_ground(columns: int, is_ground: bool) -> None:
    _, inverse_depth = street(1.5, 0.0, 0.0)
    mixed = np.random.default_rng(0).uniform(0.5, 3.0, inverse_depth.shape)
    mixed[:, :columns] = inverse_depth[:, :columns]
    assert (GroundFit().fit(mixed, CAMERA) is not None) == is_ground
