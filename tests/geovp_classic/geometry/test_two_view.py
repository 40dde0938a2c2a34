"""Motion between two images of known points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.geometry import se3, two_view
from geovp_classic.types import FloatArray

ESTIMATOR = two_view.TwoViewEstimator()
NOISE = 0.25 / 700  # a quarter of a pixel at 700 px focal length


def scene() -> FloatArray:
    rng, count = np.random.default_rng(0), 300
    return np.stack(
        [rng.uniform(-12, 12, count), rng.uniform(-4, 1.6, count), rng.uniform(6, 60, count)],
        axis=1,
    )


def rays(points: FloatArray, cam_from_world: FloatArray) -> FloatArray:
    cam = se3.transform(cam_from_world, points)
    return cam[:, :2] / cam[:, 2:]


def observations(b_from_a: FloatArray, noise: float = 0.0) -> tuple[FloatArray, FloatArray]:
    points, rng = scene(), np.random.default_rng(1)
    a, b = rays(points, np.eye(4)), rays(points, b_from_a)
    return a + rng.normal(0, noise, a.shape), b + rng.normal(0, noise, b.shape)


def angle_deg(a: FloatArray, b: FloatArray) -> float:
    return float(
        np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))
    )


@pytest.mark.parametrize(
    "translation", [(0, 0, -1), (0, 0, 1), (1, 0, 0), (-1, 0, 0), (0.1, -0.05, -1)], ids=str
)
def test_rotation_and_direction_have_the_right_sign(
    translation: tuple[float, ...],
) -> None:
    b_from_a = se3.exp(np.array([*translation, 0.01, 0.03, -0.005]))
    found = ESTIMATOR.estimate(*observations(b_from_a, NOISE), NOISE)
    assert found.has_translation
    assert angle_deg(found.b_from_a[:3, 3], b_from_a[:3, 3]) < 0.6
    assert np.degrees(se3.rotation_angle_rad(se3.inverse(found.b_from_a) @ b_from_a)) < 0.05
    assert np.linalg.norm(found.b_from_a[:3, 3]) == pytest.approx(1)
    assert found.inliers.mean() > 0.95


def test_outliers_have_no_vote_on_the_direction() -> None:
    """90 near points and 90 at infinity are inliers; 120 outliers move the opposite way."""
    forward = se3.exp(np.array([0.0, 0, -1, 0, 0.01, 0]))
    backward = se3.exp(np.array([0.0, 0, 1, 0, 0.01, 0]))
    points = scene()
    points[90:180] *= 1e4
    rng = np.random.default_rng(1)
    a = rays(points, np.eye(4))
    b = rays(points, forward)
    b[180:] = rays(points[180:], backward)
    radial = a[180:] / np.linalg.norm(a[180:], axis=1, keepdims=True)
    b[180:] += 0.05 * np.stack([-radial[:, 1], radial[:, 0]], axis=1)  # off the epipolar lines
    b += rng.normal(0, NOISE, b.shape)
    found = ESTIMATOR.estimate(a, b, NOISE)
    assert angle_deg(found.b_from_a[:3, 3], forward[:3, 3]) < 2


@given(st.floats(0.005, 0.2), st.sampled_from([0, 1, 2]))
def test_pure_rotation_has_no_translation(angle_rad: float, axis: int) -> None:
    b_from_a = se3.exp(np.concatenate([np.zeros(3), angle_rad * np.eye(3)[axis]]))
    found = ESTIMATOR.estimate(*observations(b_from_a, NOISE), NOISE)
    assert not found.has_translation
    assert np.degrees(se3.rotation_angle_rad(se3.inverse(found.b_from_a) @ b_from_a)) < 0.01
    assert found.parallax < 3 * NOISE


def test_random_points_have_an_unknown_motion() -> None:
    a, b = np.random.default_rng(0).uniform(-0.5, 0.5, (2, 200, 2))
    assert ESTIMATOR.estimate(a, b, NOISE) is None


@pytest.mark.parametrize(("num_moving", "is_static"), [(85, True), (95, False)])
@pytest.mark.parametrize("turn_rad", [0.0, 0.05])
def test_a_static_motion_needs_seven_tenths_of_the_points(
    num_moving: int, is_static: bool, turn_rad: float
) -> None:
    a, b = observations(se3.exp(np.array([0, 0, 0, 0, turn_rad, 0])))
    b[:num_moving] += np.random.default_rng(3).uniform(0.02, 0.2, (num_moving, 2))  # of 300
    found = ESTIMATOR.estimate(a, b, NOISE)
    assert (found is not None and not found.has_translation) == is_static


def test_parallax_is_the_median_shift_and_inliers_are_within_three_deviations() -> None:
    a, _ = observations(np.eye(4))
    b = a + np.repeat(
        [[2.9 * NOISE, 0], [0, 0.5 * NOISE], [-3.1 * NOISE, 0]], [40, 200, 60], axis=0
    )
    found = ESTIMATOR.estimate(a, b, NOISE)
    assert found.parallax == pytest.approx(0.5 * NOISE)
    np.testing.assert_array_equal(found.b_from_a, np.eye(4))
    np.testing.assert_array_equal(found.inliers, np.arange(300) < 240)


def test_eight_points_are_enough_and_seven_are_not() -> None:
    a, b = observations(np.eye(4), NOISE)
    assert ESTIMATOR.estimate(a[:8], b[:8], NOISE) is not None
    assert ESTIMATOR.estimate(a[:7], b[:7], NOISE) is None
