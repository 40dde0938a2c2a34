"""The road's samples in another image, their derivatives, and the step that aligns them."""

import cv2
import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import homogeneous
from geovp_classic.odometry import road
from geovp_classic.odometry.lens import Lens
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(120.0, 118.0, 63.5, 40.0, 128, 112)
POSE = se3.exp(np.array([0.1, 0.02, 1.2, 0.01, -0.02, 0.005]))
PLANE = road.level_plane(1.6, 0.01, -0.02)


@pytest.fixture
def lens() -> Lens:
    return Lens(CAMERA, 0.03)


@pytest.fixture
def rays(lens: Lens) -> FloatArray:
    """Rays of the whole image and of some beyond it, above the horizon, too."""
    return lens.rays(np.random.default_rng(0).uniform([-30, 10], [158, 140], (500, 2)))


def test_the_road_projects_into_the_other_camera_where_its_points_lie(lens: Lens) -> None:
    pixels = np.random.default_rng(0).uniform([-30, 10], [158, 140], (500, 2))
    points, projected, index = road._project(lens, homogeneous(lens.rays(pixels)), POSE, PLANE)
    rays = homogeneous(lens.rays(pixels[index]))
    inverse_depth = rays @ PLANE
    np.testing.assert_allclose(
        points / inverse_depth[:, None], se3.transform(POSE, rays / inverse_depth[:, None])
    )
    np.testing.assert_allclose(
        lens.rays(projected), points[:, :2] / points[:, 2:], atol=2e-4
    )  # an iterative inverse
    assert 100 < len(index) < 400
    assert (projected > 1).all()
    assert (projected < (126, 110)).all()


def test_the_jacobian_is_the_difference_of_pixels_of_neighbouring_planes(rays: FloatArray) -> None:
    # m . r of the ray (x, y, 1) grows by d when the plane's last number does; the lens is a pinhole
    # here
    lens, tiny, rays = Lens(CAMERA), 1e-6, rays[rays[:, 1] > 0.1]

    def places(more: float) -> FloatArray:
        points = se3.transform(
            POSE, homogeneous(rays) / (homogeneous(rays) @ PLANE + more)[:, None]
        )
        return lens.pixels(points[:, :2] / points[:, 2:])

    expected = (places(tiny) - places(-tiny)) / (2 * tiny)
    points = homogeneous(rays) @ POSE[:3, :3].T + (homogeneous(rays) @ PLANE)[:, None] * POSE[:3, 3]
    jacobian = road._pixel_jacobian(points, POSE[:3, 3], lens)
    np.testing.assert_allclose(jacobian, expected, rtol=1e-5, atol=1e-5)


def test_the_step_is_that_of_weighted_least_squares_with_an_offset() -> None:
    rng = np.random.default_rng(2)
    difference, jacobian = rng.normal(0, 10, 401), rng.normal(0, 50, (401, 3))
    step = np.linalg.solve(*road._normal_equations(difference, jacobian))
    centred = difference - np.median(difference)
    root = 1 / (
        1 + (centred / (2 * 1.4826 * np.median(np.abs(centred)))) ** 2
    )  # of the Geman-McClure weights
    with_offset = np.concatenate([jacobian, np.ones((401, 1))], axis=1)
    expected = np.linalg.lstsq(with_offset * root[:, None], centred * root)[0]
    np.testing.assert_allclose(step, expected[:3], rtol=1e-9)


def test_correlation_is_that_of_numpy(lens: Lens) -> None:
    a, b = np.random.default_rng(3).normal(100, 20, (2, 112, 128)).astype(np.float32)
    v, u = np.mgrid[60:100:2, 10:120:2]
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float64)
    rays = homogeneous(Lens(CAMERA).rays(pixels))
    given = np.eye(4), Lens(CAMERA), rays, PLANE
    expected = np.corrcoef(a[v, u].ravel(), (a + b)[v, u].ravel())[0, 1]
    assert road.correlation(a + b, a[v, u].ravel(), *given) == pytest.approx(expected, rel=1e-5)
    assert road.correlation(a, np.full(v.size, 7, np.float32), *given) == 0.0
    assert (
        road.correlation(
            a, a[v, u].ravel(), np.eye(4), Lens(CAMERA), rays + np.array([9.0, 0, 0]), PLANE
        )
        == -1.0
    )


def test_samples_lie_between_pixels() -> None:
    # 10 + 2 u + 3 v at (4.25, 2.5) is 26
    v, u = np.mgrid[:8, :9]
    image = (10 + 2 * u + 3 * v).astype(np.float32)
    at = np.array([[4.25, 2.5]], dtype=np.float32)
    np.testing.assert_allclose(road.sample(image, at), [26.0], rtol=1e-6)
    np.testing.assert_allclose(
        road.sample(cv2.merge([image, -image]), at), [[26.0, -26.0]], rtol=1e-6
    )
