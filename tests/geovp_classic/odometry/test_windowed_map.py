"""Predicted pixels and parallax of a window of keyframes, against loops over its points."""

import numpy as np
import pytest

from geovp_classic.geometry import se3, two_view
from geovp_classic.odometry import windowed_map
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.windowed_map import WindowedMap
from geovp_classic.types import FloatArray, Intrinsics

LENS = Lens(Intrinsics(200.0, 205.0, 128.0, 90.0, 256, 180), radial=0.02)
MOTION = se3.exp(np.array([0.3, -0.1, -1.0, 0.02, -0.05, 0.01]))


@pytest.fixture
def rays() -> FloatArray:
    """Of 200 points [200, 2], all over the image."""
    return LENS.rays(np.random.default_rng(0).uniform([0, 0], [256, 180], (200, 2)))


def slow_prediction(window: WindowedMap, motion: FloatArray) -> FloatArray:
    """Each active point moved at its own depth or at that of its three neighbours."""
    known, predicted = window.triangulated, window.pixels.copy()
    inverse_depth = 1 / np.maximum(window.points[:, 2], 1e-3)
    for n, pixel in enumerate(window.pixels):
        nearest = np.argsort(np.linalg.norm(window.pixels[known] - pixel, axis=1))[:3]
        inverse = inverse_depth[n] if known[n] else inverse_depth[known][nearest].mean()
        x, y, z = motion[:3, :3] @ (*window.lens.rays(pixel), 1.0) / inverse + motion[:3, 3]
        if z > 1e-6:
            predicted[n] = window.lens.pixels(np.array([x / z, y / z]))
    return predicted


def slow_parallax(rays: FloatArray, cam_from_world: FloatArray) -> FloatArray:
    """The greatest distance of a point's directions from its first one, in the world, of length 1."""
    largest = np.zeros(rays.shape[1])
    for n in range(rays.shape[1]):
        views = np.flatnonzero(np.isfinite(rays[:, n, 0]))
        directions = [cam_from_world[view, :3, :3].T @ (*rays[view, n], 1.0) for view in views]
        directions = [direction / np.linalg.norm(direction) for direction in directions]
        largest[n] = max(np.linalg.norm(direction - directions[0]) for direction in directions)
    return largest


@pytest.mark.parametrize("share_known", [0.1, 0.8])
def test_points_are_predicted_as_one_by_one(rays: FloatArray, share_known: float) -> None:
    rng, window = np.random.default_rng(1), WindowedMap(LENS, 0.25, 8)
    window.add_keyframe(np.eye(4))
    window.add_tracks(LENS.pixels(rays))
    depth = rng.uniform(0.3, 4, len(rays))  # those nearer than a metre come behind the camera
    window.points = np.where(
        rng.uniform(size=(len(rays), 1)) < share_known,
        two_view.homogeneous(rays) * depth[:, None],
        np.nan,
    )
    expected = slow_prediction(window, MOTION)
    assert (expected == window.pixels).any()
    np.testing.assert_allclose(window.predict_pixels(np.eye(4), MOTION), expected, rtol=1e-9)


def test_parallax_is_the_median_shift_of_what_stays_in_front(rays: FloatArray) -> None:
    window = WindowedMap(LENS, 0.25, 8)
    window.add_keyframe(np.eye(4))
    window.add_tracks(LENS.pixels(rays))
    for turn_rad, all_in_front in ((0.1, True), (1.4, False)):
        pose = se3.exp(np.array([0, 0, 0, 0, turn_rad, 0]))
        before = two_view.rotate_rays(pose[:3, :3], rays)
        assert np.isfinite(before).all() == all_in_front
        expected = np.nanmedian(np.linalg.norm(rays - before, axis=1))
        assert window.parallax(pose) == pytest.approx(expected, rel=1e-3)
    assert np.isnan(window.parallax(se3.exp(np.array([0, 0, 0, 0, np.pi, 0]))))


def test_the_largest_parallax_is_that_of_a_loop(rays: FloatArray) -> None:
    rng, poses = np.random.default_rng(3), np.stack([np.eye(4), MOTION, MOTION @ MOTION])
    views = rays + rng.normal(0, 0.05, (3, *rays.shape))
    views[rng.integers(0, 3, 200), np.arange(200)] = np.nan
    np.testing.assert_allclose(
        windowed_map.max_parallax(views, poses), slow_parallax(views, poses), rtol=1e-9
    )
