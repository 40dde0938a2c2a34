"""The road as a plane: its samples, its correlation, and its alignment."""

import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.odometry.road import RoadAligner, RoadPair, level_plane, sample
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

ROAD = RoadAligner()


def test_a_level_plane_by_hand() -> None:
    np.testing.assert_allclose(level_plane() / 2, [0, 0.5, 0])
    # looking 0.1 rad up, the normal points down and backwards
    np.testing.assert_allclose(level_plane(pitch_rad=0.1), [0, np.cos(0.1), -np.sin(0.1)])
    np.testing.assert_allclose(level_plane(roll_rad=0.1), [np.sin(0.1), np.cos(0.1), 0])


def test_samples_lie_on_the_road_ahead(camera: Intrinsics) -> None:
    pixels = ROAD.samples(camera, level_plane())
    rays = pinhole.normalised(pixels, camera)
    depth = 1 / rays[:, 1]  # in camera heights
    assert len(pixels) > 300
    assert depth.min() > ROAD.min_distance
    assert depth.max() < ROAD.max_distance
    assert np.abs(rays[:, 0] * depth).max() < ROAD.half_width


def test_values_between_pixels() -> None:
    # 10 + 2 u + 3 v at (4.25, 2.5) is 26
    v, u = np.mgrid[:8, :9]
    image = (10 + 2 * u + 3 * v).astype(np.float32)
    pixels = np.array([[4.25, 2.5]])
    np.testing.assert_allclose(sample(image, pixels), [26.0], rtol=1e-6)
    both = np.stack([image, -image], axis=-1)
    np.testing.assert_allclose(sample(both, pixels), [[26.0, -26.0]], rtol=1e-6)


def test_correlation_is_that_of_numpy() -> None:
    camera = Intrinsics(120.0, 118.0, 63.5, 40.0, 128, 112)
    a, b = np.random.default_rng(3).normal(100, 20, (2, 112, 128)).astype(np.float32)
    v, u = np.mgrid[60:100:2, 10:120:2]
    rays = pinhole.unproject(np.stack([u.ravel(), v.ravel()], axis=1), 1.0, camera)
    values = a[v, u].ravel()
    expected = np.corrcoef(values, (a + b)[v, u].ravel())[0, 1]

    def correlation(before: FloatArray, values: FloatArray, rays: FloatArray) -> FloatArray:
        plane = level_plane(0.01, -0.02) / 1.6
        pair = RoadPair(a, b, np.eye(4), camera)
        return ROAD.correlation(before, values, pair, rays, plane)

    assert correlation(a + b, values, rays) == pytest.approx(expected, rel=1e-5)
    assert correlation(a, np.full(v.size, 7.0), rays) == 0.0
    assert correlation(a, values, rays + np.array([9.0, 0, 0])) == -1.0


@pytest.mark.parametrize("offset", [0, 20])
def test_alignment_finds_the_plane(
    straight: tuple[ByteArray, FloatArray], camera: Intrinsics, offset: int
) -> None:
    frames, poses = straight
    greys = np.clip(frames[:2, ..., 0], offset, 255)
    before, now = ROAD.blurred(greys[0] - np.uint8(offset)), ROAD.blurred(greys[1])
    pair = RoadPair(before, now, se3.inverse(poses[0]) @ poses[1], camera)
    pixels = ROAD.samples(camera, level_plane())
    measured = ROAD.align(pair, pixels, level_plane() / 1.75, tilt_rad=0.02)
    assert measured is not None
    height = 1 / np.linalg.norm(measured.plane)
    assert height == pytest.approx(1.65, rel=0.03)  # above the corridor
