"""Two images of known points: the motion between them, what it cannot be told from, and how deep the points are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.geometry import se3, two_view
from geovp_classic.geometry.two_view import homogeneous
from geovp_classic.types import FloatArray

NOISE = 0.25 / 700  # a quarter of a pixel at 700 px focal length


def scene(seed: int, count: int = 300) -> FloatArray:
    rng = np.random.default_rng(seed)
    return np.stack([rng.uniform(-12, 12, count), rng.uniform(-4, 1.6, count), rng.uniform(6, 60, count)], axis=1)


def rays(points: FloatArray, cam_from_world: FloatArray) -> FloatArray:
    cam = se3.transform(cam_from_world, points)
    return cam[:, :2] / cam[:, 2:]


def sights(b_from_a: FloatArray, noise: float = 0.0, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    points, rng = scene(seed), np.random.default_rng(seed + 1)
    a, b = rays(points, np.eye(4)), rays(points, b_from_a)
    return a + rng.normal(0, noise, a.shape), b + rng.normal(0, noise, b.shape)


def angle_deg(a: FloatArray, b: FloatArray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1))))


@pytest.mark.parametrize("translation", [(0, 0, -1), (0, 0, 1), (1, 0, 0), (-1, 0, 0), (0.1, -0.05, -1)], ids=str)
def test_rotation_and_direction_come_back_with_the_right_sign(translation: tuple[float, ...]) -> None:
    b_from_a = se3.exp(np.array([*translation, 0.01, 0.03, -0.005]))
    found = two_view.two_view(*sights(b_from_a, NOISE), NOISE)
    assert found.kind == "general"
    assert angle_deg(found.b_from_a[:3, 3], b_from_a[:3, 3]) < 0.6
    assert np.degrees(se3.rotation_angle_rad(se3.inverse(found.b_from_a) @ b_from_a)) < 0.05
    assert np.linalg.norm(found.b_from_a[:3, 3]) == pytest.approx(1)
    assert found.inliers.mean() > 0.95


def test_a_third_of_wrong_points_is_left_out() -> None:
    b_from_a = se3.exp(np.array([0, 0, -1, 0, 0.02, 0]))
    a, b = sights(b_from_a, NOISE)
    b[:100] += np.random.default_rng(9).uniform(-0.2, 0.2, (100, 2))
    found = two_view.two_view(a, b, NOISE)
    assert angle_deg(found.b_from_a[:3, 3], b_from_a[:3, 3]) < 2
    assert found.inliers[100:].mean() > 0.95
    assert found.inliers[:100].mean() < 0.2


def test_standing_still_is_no_motion_even_with_traffic() -> None:
    a, b = sights(np.eye(4), NOISE)
    b[:60] += 0.05  # a fifth of the points drives by
    found = two_view.two_view(a, b, NOISE)
    assert found.kind == "still"
    np.testing.assert_array_equal(found.b_from_a, np.eye(4))
    assert not found.inliers[:60].any()


@given(st.floats(0.005, 0.2), st.sampled_from([0, 1, 2]))
def test_pure_rotation_has_no_translation(angle_rad: float, axis: int) -> None:
    b_from_a = se3.exp(np.concatenate([np.zeros(3), angle_rad * np.eye(3)[axis]]))
    found = two_view.two_view(*sights(b_from_a, NOISE), NOISE)
    assert found.kind == "rotation"
    np.testing.assert_array_equal(found.b_from_a[:3, 3], 0)
    assert np.degrees(se3.rotation_angle_rad(se3.inverse(found.b_from_a) @ b_from_a)) < 0.01
    assert found.parallax < 3 * NOISE


def test_too_few_or_random_points_are_no_motion() -> None:
    a, b = sights(se3.exp(np.array([0, 0, -1.0, 0, 0, 0])))
    assert two_view.two_view(a[:7], b[:7], NOISE).kind == "unknown"
    rng = np.random.default_rng(0)
    found = two_view.two_view(rng.uniform(-0.5, 0.5, (200, 2)), rng.uniform(-0.5, 0.5, (200, 2)), NOISE)
    assert found.kind == "unknown"
    assert not found.inliers.any()


def test_the_same_seed_gives_the_same_bytes() -> None:
    a, b = sights(se3.exp(np.array([0, 0, -1.0, 0, 0.02, 0])), 3 * NOISE)
    first, again = (two_view.two_view(a, b, NOISE, seed=5) for _ in range(2))
    np.testing.assert_array_equal(first.b_from_a, again.b_from_a)


def test_all_four_decompositions_are_proper_rotations_of_one_essential_matrix() -> None:
    b_from_a = se3.exp(np.array([0.6, 0, -0.8, 0.1, 0.2, 0.3]))
    direction = b_from_a[:3, 3] / np.linalg.norm(b_from_a[:3, 3])
    candidates = two_view.decompose(se3.cross_matrix(direction) @ b_from_a[:3, :3])
    np.testing.assert_allclose(np.linalg.det(candidates[:, :3, :3]), 1)
    a, b = sights(b_from_a)
    for candidate in candidates:
        np.testing.assert_allclose(two_view.sampson(a, b, candidate), 0, atol=1e-12)
    assert min(np.abs(candidate[:3, :3] - b_from_a[:3, :3]).max() for candidate in candidates) < 1e-9


def test_refinement_finds_the_motion_again_from_nearby() -> None:
    truth = se3.exp(np.array([0, 0, -1.0, 0, 0.02, 0]))
    truth[:3, 3] /= np.linalg.norm(truth[:3, 3])
    near = se3.exp(np.array([0.05, -0.03, 0, 0.004, -0.003, 0.002])) @ truth
    near[:3, 3] /= np.linalg.norm(near[:3, 3])
    found = two_view.refine(*sights(truth), near, NOISE, num_rounds=20)
    np.testing.assert_allclose(found, truth, atol=1e-6)


def slow_equations(
    rays_a: FloatArray, rays_b: FloatArray, b_from_a: FloatArray, across: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Of Sampson distances with Cauchy weights; slopes are those of the algebraic distances, over the gradients."""
    a, b, rotation, direction = homogeneous(rays_a), homogeneous(rays_b), b_from_a[:3, :3], b_from_a[:3, 3]
    essential, turned = se3.cross_matrix(direction) @ rotation, a @ rotation.T
    line_b, line_a = (a @ essential.T)[:, :2], (b @ essential)[:, :2]
    gradient = np.linalg.norm(np.concatenate([line_a, line_b], axis=1), axis=1)[:, None]
    residual = two_view.sampson(rays_a, rays_b, b_from_a)
    by_rotation = np.cross(turned, np.cross(b, direction))  # b . (t x (w x Ra)) = w . (Ra x (b x t))
    by_direction = np.cross(turned, b) @ across.T  # b . (dt x Ra) = dt . (Ra x b)
    slopes = np.concatenate([by_rotation, by_direction], axis=1) / gradient
    weighted = slopes / (1 + (residual / NOISE) ** 2)[:, None]
    return weighted.T @ slopes, weighted.T @ residual


def test_equations_of_the_refinement_are_those_of_the_slow_twin() -> None:
    truth = se3.exp(np.array([0.1, -0.05, -1.0, 0.01, 0.02, -0.005]))
    truth[:3, 3] /= np.linalg.norm(truth[:3, 3])
    across = np.linalg.svd(truth[None, :3, 3])[2][1:]
    a, b = sights(truth, noise=NOISE)
    normal, moment = two_view._equations(a, b, truth, across, NOISE)
    expected_normal, expected_moment = slow_equations(a, b, truth, across)
    np.testing.assert_allclose(normal, expected_normal, rtol=1e-6, atol=1e-9 * np.abs(expected_normal).max())
    np.testing.assert_allclose(moment, expected_moment, rtol=1e-6, atol=1e-9 * np.abs(expected_moment).max())


def test_depths_of_one_point_by_hand() -> None:
    # a point 10 ahead; b has moved 2 forward, so that it is 8 ahead there
    b_from_a = se3.compose(np.eye(3), np.array([0.0, 0, -2]))
    depth_a, depth_b = two_view.depths(np.array([[0.1, 0.0]]), np.array([[1 / 8, 0.0]]), b_from_a)
    assert depth_a[0] == pytest.approx(10)
    assert depth_b[0] == pytest.approx(8)


def test_rays_that_leave_the_front_are_nan() -> None:
    turned = two_view.rotate_rays(se3.exp(np.array([0, 0, 0, 0, np.pi, 0]))[:3, :3], np.array([[0.1, 0.2]]))
    assert np.isnan(turned).all()
