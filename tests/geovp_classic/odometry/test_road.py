"""The road as a plane: its samples, its correlation, and its alignment."""

import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.odometry.road import RoadAligner, RoadPair, level_plane
from tests.geovp_classic.odometry.corridor import CAMERA, STRAIGHT

ROAD = RoadAligner()


def test_a_level_plane_by_hand() -> None:
    np.testing.assert_allclose(level_plane() / 2, [0, 0.5, 0])
    # looking 0.1 rad up, the normal points down and backwards
    np.testing.assert_allclose(level_plane(pitch_rad=0.1), [0, np.cos(0.1), -np.sin(0.1)])
    np.testing.assert_allclose(level_plane(roll_rad=0.1), [np.sin(0.1), np.cos(0.1), 0])


def test_samples_lie_on_the_road_ahead() -> None:
    pixels = ROAD.samples(CAMERA, level_plane())
    rays = pinhole.normalised(pixels, CAMERA)
    depth = 1 / rays[:, 1]  # in CAMERA heights
    assert len(pixels) > 300
    assert depth.min() > ROAD.min_distance
    assert depth.max() < ROAD.max_distance
    assert np.abs(rays[:, 0] * depth).max() < ROAD.half_width


def test_correlation_is_that_of_numpy() -> None:
    before, now = np.random.default_rng(3).normal(100, 20, (2, 192, 256)).astype(np.float32)
    before += now
    v, u = np.mgrid[120:180:2, 10:240:2].reshape(2, -1)
    rays = pinhole.unproject(np.stack([u, v], axis=1), 1.0, CAMERA)
    pair = RoadPair(before, now, np.eye(4), CAMERA)
    found = ROAD.correlation(before, now[v, u], pair, rays, level_plane() / 1.6)
    assert found == pytest.approx(np.corrcoef(before[v, u], now[v, u])[0, 1], rel=1e-5)


@pytest.mark.parametrize("offset", [0, 20])
def test_alignment_finds_the_plane(offset: int) -> None:
    frames, poses = STRAIGHT
    greys = np.clip(frames[:2, ..., 0], offset, 255)
    before, now = ROAD.blurred(greys[0] - np.uint8(offset)), ROAD.blurred(greys[1])
    pair = RoadPair(before, now, se3.inverse(poses[0]) @ poses[1], CAMERA)
    pixels = ROAD.samples(CAMERA, level_plane())
    measured = ROAD.align(pair, pixels, level_plane() / 1.75, tilt_rad=0.02)
    height = 1 / np.linalg.norm(measured.plane)
    assert height == pytest.approx(1.65, rel=0.03)  # above the corridor
