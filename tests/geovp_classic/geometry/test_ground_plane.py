"""The road as a plane in inverse depth."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geovp_classic.geometry import ground_plane
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(100.0, 110.0, 60.0, 45.0, 120, 96)


def _street(
    height: float, pitch_rad: float, roll_rad: float
) -> tuple[ground_plane.GroundPlane, FloatArray]:
    normal = np.array(
        [
            np.sin(roll_rad),
            np.cos(pitch_rad) * np.cos(roll_rad),
            np.sin(pitch_rad) * np.cos(roll_rad),
        ]
    )
    plane = ground_plane.GroundPlane(normal, height)
    return plane, np.maximum(plane.inverse_depth(CAMERA), 0.02 / height)  # and a wall far away


def test_inverse_depth_of_level_ground() -> None:
    # the row 55 px below the centre looks down by 55 / 110 per metre ahead: 1.5 m below is 3 m
    # ahead
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
    confidence = level.confidence(
        1 / (1.5 * np.array([0.5, 4.0, 8.0, 16.0, -3.0]))
    )  # distances in camera heights
    np.testing.assert_allclose(confidence, [1, 1, 1 / 4, 1 / 16, 0])


def test_what_hangs_low_over_the_road_is_told_from_what_stands_on_it_and_from_what_hangs_high() -> (
    None
):
    plane, inverse_depth = _street(1.5, 0.0, 0.0)
    islands = np.zeros(inverse_depth.shape, dtype=bool)
    hanging, standing, high = np.s_[50:58, 10:30], np.s_[50:78, 40:60], np.s_[5:15, 80:100]
    for place, depth in ((hanging, 4.0), (standing, 5.0), (high, 6.0)):
        inverse_depth[place], islands[place] = (
            1 / depth,
            True,
        )  # hanging: 1.0 to 1.3 m above the road
    found = ground_plane.floating_mask(inverse_depth, plane, CAMERA, islands)
    assert found[hanging].all()
    assert found.sum() == found[hanging].sum()
    assert not ground_plane.floating_mask(
        inverse_depth, plane, CAMERA, np.zeros_like(islands)
    ).any()


@pytest.mark.parametrize(("tilt_deg", "found"), [(22.0, True), (29.0, False)])
def test_a_plane_is_ground_up_to_a_tilt_whose_cosine_is_nine_tenths(
    tilt_deg: float, found: bool
) -> None:
    _, inverse_depth = _street(1.5, 0.0, np.deg2rad(tilt_deg))  # 25.8 degrees
    assert (ground_plane.fit_ground(inverse_depth, CAMERA) is not None) == found


@pytest.mark.parametrize(("columns", "found"), [(36, True), (16, False)])
def test_a_fifth_of_the_lower_half_must_lie_on_it(columns: int, found: bool) -> None:
    plane, inverse_depth = _street(1.5, 0.0, 0.0)
    noise = np.random.default_rng(0).uniform(0.5, 3.0, inverse_depth.shape)
    noise[:, :columns] = inverse_depth[:, :columns]
    fitted = ground_plane.fit_ground(noise, CAMERA)
    assert (fitted is not None) == found
    if fitted is not None:
        np.testing.assert_allclose(fitted.normal, plane.normal, atol=0.01)
        assert fitted.height == pytest.approx(1.5, rel=0.01)


def test_only_the_lower_half_is_looked_at_and_other_surfaces_do_not_bend_the_plane() -> None:
    plane, inverse_depth = _street(1.5, 0.03, 0.02)
    inverse_depth[:48] = np.random.default_rng(0).uniform(0, 5, (48, 120))
    inverse_depth[48:, :40] *= 1.5  # a car
    found = ground_plane.fit_ground(inverse_depth, CAMERA)
    assert found is not None
    np.testing.assert_allclose(found.normal, plane.normal, atol=1e-4)
    assert found.height == pytest.approx(1.5, rel=1e-4)


def test_a_surface_within_a_twentieth_counts_as_the_plane() -> None:
    plane, inverse_depth = _street(1.5, 0.0, 0.0)
    rng = np.random.default_rng(0)
    found = ground_plane.fit_ground(
        inverse_depth * rng.uniform(0.96, 1.04, inverse_depth.shape), CAMERA
    )
    assert found is not None
    np.testing.assert_allclose(found.normal, plane.normal, atol=0.01)
    scattered = inverse_depth * rng.uniform(
        0.5, 1.5, inverse_depth.shape
    )  # a tenth of them within a twentieth
    assert ground_plane.fit_ground(scattered, CAMERA) is None


def test_ground_is_clamped_up_to_twenty_camera_heights() -> None:
    plane, _ = _street(1.5, 0.0, 0.0)
    # row 45 + d looks 110 / d camera heights far: 20 at d = 5.5
    clamped = ground_plane.clamp_to_ground(
        np.zeros((96, 120)), plane, CAMERA, np.ones((96, 120), bool)
    )
    assert not clamped[:51].any()
    np.testing.assert_allclose(clamped[51:, 0], np.arange(6, 51) / 110 / 1.5, rtol=1e-6)


@pytest.mark.parametrize(
    ("lowest", "highest", "floats"),
    [
        (0.25, 1.4, True),
        (0.1, 1.4, False),
        (0.35, 1.55, True),
        (0.35, 1.75, False),
        (0.0, 0.2, False),
    ],
)
def test_an_island_floats_between_a_third_and_one_and_a_half_camera_heights(
    lowest: float, highest: float, floats: bool
) -> None:
    # all but a tenth at either end; seen at depth z, the row d below the horizon is 1 - d z / 110
    # above the ground
    plane = ground_plane.GroundPlane(np.array([0.0, 1.0, 0.0]), 1.0)
    depth, rows = 4.0, 45 + np.rint(110 * (1 - np.array([highest, lowest])) / 4.0).astype(int)
    islands = np.zeros((96, 120), bool)
    islands[rows[0] : rows[1] + 1, 50:60] = True
    islands[10:20, 100:110] = (
        True  # another one, far above: 0.9 m less a row's share of 25 to 35 / 110 of 9 m
    )
    inverse_depth = np.where(islands, 1 / depth, 0.0)
    found = ground_plane.floating_mask(inverse_depth, plane, CAMERA, islands)
    assert found[:, 50:60].any() == floats
    assert not found[10:20, 100:110].any()
