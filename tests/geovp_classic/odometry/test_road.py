"""Compiled loops over the road's samples and over the lens's rays, against slow twins in numpy."""

import cv2
import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import homogeneous
from geovp_classic.odometry import road
from geovp_classic.odometry.lens import Lens
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

CAMERA = Intrinsics(120.0, 118.0, 63.5, 40.0, 128, 112)
POSE = se3.exp(np.array([0.1, 0.02, 1.2, 0.01, -0.02, 0.005]))
PLANE = road.level_plane(1.6, 0.01, -0.02)


def slow_rays(lens: Lens, pixels: FloatArray) -> FloatArray:
    """The lens's equation as it stands in its docstring."""
    camera = lens.camera
    seen = (pixels - (camera.cx_px, camera.cy_px)) / (camera.fx_px, camera.fy_px)
    return seen * (1 + lens.radial * (seen**2).sum(axis=-1, keepdims=True))


def slow_pixels(lens: Lens, rays: FloatArray) -> FloatArray:
    """Its inverse, by three fixed-point steps."""
    seen, camera = rays, lens.camera
    for _ in range(3):
        seen = rays / (1 + lens.radial * (seen**2).sum(axis=-1, keepdims=True))
    return seen * (camera.fx_px, camera.fy_px) + (camera.cx_px, camera.cy_px)


def slow_elsewhere(rays: FloatArray, lens: Lens) -> tuple[FloatArray, BoolArray]:
    """Where the plane's points on rays [N, 2] are seen by the other camera, and whether they are."""
    rays = homogeneous(rays)
    points = rays @ POSE[:3, :3].T + (rays @ PLANE)[:, None] * POSE[:3, 3]
    front = points[:, 2] > 1e-3
    pixels = slow_pixels(lens, points[:, :2] / np.where(front, points[:, 2], 1.0)[:, None])
    limit = (lens.camera.width_px - 2, lens.camera.height_px - 2)
    return pixels, front & (pixels > 1).all(axis=1) & (pixels < limit).all(axis=1)


def slow_equations(
    rays: FloatArray, speed: FloatArray, values: FloatArray, wanted: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Gauss-Newton with Geman-McClure weights, less one offset for the brightness."""
    by_plane = (values[:, 1:] * speed).sum(axis=1)[:, None] * homogeneous(rays)
    difference = values[:, 0].astype(np.float64) - wanted
    difference = difference - np.median(difference)
    spread = max(road.GREY_NOISE, 1.4826 * float(np.median(np.abs(difference))))
    weight = 1 / (1 + (difference / (2 * spread)) ** 2) ** 2
    by_plane = by_plane - weight @ by_plane / weight.sum()
    return by_plane.T @ (weight[:, None] * by_plane) / spread**2, by_plane.T @ (weight * difference) / spread**2


@pytest.fixture
def lens() -> Lens:
    return Lens(CAMERA, 0.03)


@pytest.fixture
def rays(lens: Lens) -> FloatArray:
    """Rays of the whole image and of some beyond it, above the horizon, too."""
    return lens.rays(np.random.default_rng(0).uniform([-30, 10], [158, 140], (500, 2)))


@pytest.mark.parametrize("radial", [0.0, 0.03])
def test_rays_and_pixels_are_those_of_the_slow_twins(radial: float) -> None:
    lens, pixels = Lens(CAMERA, radial), np.random.default_rng(1).uniform(0, 128, (3, 40, 2))
    pixels[1, 5] = np.nan
    np.testing.assert_array_equal(lens.rays(pixels), slow_rays(lens, pixels))
    np.testing.assert_array_equal(lens.seen_rays(pixels), slow_rays(Lens(CAMERA), pixels))
    np.testing.assert_array_equal(lens.pixels(lens.rays(pixels)), slow_pixels(lens, slow_rays(lens, pixels)))


def test_the_road_is_seen_elsewhere_where_the_slow_twin_says(lens: Lens, rays: FloatArray) -> None:
    expected, seen = slow_elsewhere(rays, lens)
    there, index = road._elsewhere(rays, POSE, PLANE, *road._numbers(lens))
    assert 0.2 < seen.mean() < 0.8
    np.testing.assert_array_equal(index, np.flatnonzero(seen))
    np.testing.assert_array_equal(there, expected[seen].astype(np.float32))


def test_speed_is_the_difference_of_places_of_neighbouring_planes(rays: FloatArray) -> None:
    # m . r of the ray (x, y, 1) grows by d when the plane's last number does; the lens is a pinhole here
    lens, tiny, rays = Lens(CAMERA), 1e-6, rays[rays[:, 1] > 0.1]

    def places(more: float) -> FloatArray:
        points = se3.transform(POSE, homogeneous(rays) / (homogeneous(rays) @ PLANE + more)[:, None])
        return lens.pixels(points[:, :2] / points[:, 2:])

    expected = (places(tiny) - places(-tiny)) / (2 * tiny)
    speed = road._speed(rays, POSE, PLANE, CAMERA.fx_px, CAMERA.fy_px)
    np.testing.assert_allclose(speed, expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("count", [400, 401])
def test_equations_are_those_of_the_slow_twin(rays: FloatArray, count: int) -> None:
    rng = np.random.default_rng(2)
    values, wanted = rng.normal(0, 10, (count, 3)).astype(np.float32), rng.normal(0, 10, count).astype(np.float32)
    given = rays[:count], rng.normal(0, 50, (count, 2)), values, wanted
    for fast, slow in zip(road._equations(*given), slow_equations(*given), strict=True):
        np.testing.assert_allclose(fast, slow, rtol=1e-9, atol=1e-12 * np.abs(slow).max())


def test_correlation_is_that_of_numpy() -> None:
    a, b = np.random.default_rng(3).normal(100, 20, (2, 300)).astype(np.float32)
    assert road._correlation(a, a + b) == pytest.approx(np.corrcoef(a, a + b)[0, 1], rel=1e-5)
    assert road._correlation(a, np.full_like(a, 7)) == 0.0


def test_samples_lie_between_pixels() -> None:
    # 10 + 2 u + 3 v at (4.25, 2.5) is 26
    v, u = np.mgrid[:8, :9]
    image = (10 + 2 * u + 3 * v).astype(np.float32)
    at = np.array([[4.25, 2.5]], dtype=np.float32)
    np.testing.assert_allclose(road._sample(image, at), [26.0], rtol=1e-6)
    np.testing.assert_allclose(road._sample(cv2.merge([image, -image]), at), [[26.0, -26.0]], rtol=1e-6)
