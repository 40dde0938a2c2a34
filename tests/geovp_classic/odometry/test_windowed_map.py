"""Compiled loops over the points of a window of keyframes, against slow twins in numpy."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

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
    """Each followed point carried along, at its own depth or at that of its three neighbours."""
    known = window.known
    depth = np.full(len(known), 1e9)
    depth[known] = np.maximum(window.points[known, 2], 1e-3)
    near = cKDTree(window.pixels[known]).query(window.pixels[~known], k=3)[1]
    depth[~known] = 1 / (1 / depth[known])[near].mean(axis=1)
    ahead = se3.transform(motion, two_view.homogeneous(window.lens.rays(window.pixels)) * depth[:, None])
    front = ahead[:, 2:] > 1e-6
    return np.where(front, LENS.pixels(ahead[:, :2] / np.where(front, ahead[:, 2:], 1.0)), window.pixels)


def slow_spread(rays: FloatArray, cam_from_world: FloatArray) -> FloatArray:
    """The greatest distance from the first ray, all turned into the world's axes, of length 1."""
    turned = two_view.homogeneous(rays) @ cam_from_world[:, :3, :3]
    turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
    first = turned[np.isfinite(turned[..., 0]).argmax(axis=0), np.arange(turned.shape[1])]
    return np.asarray(np.nanmax(np.linalg.norm(turned - first, axis=-1), axis=0))


@pytest.mark.parametrize("share_known", [0.1, 0.8])
def test_points_are_predicted_as_by_the_slow_twin(rays: FloatArray, share_known: float) -> None:
    rng, window = np.random.default_rng(1), WindowedMap(LENS, 0.25, 8)
    window.insert(np.eye(4))
    window.add(LENS.pixels(rays))
    depth = rng.uniform(0.3, 4, len(rays))  # those nearer than a metre come behind the camera
    window.points = np.where(
        rng.uniform(size=(len(rays), 1)) < share_known, two_view.homogeneous(rays) * depth[:, None], np.nan
    )
    expected = slow_prediction(window, MOTION)
    assert (expected == window.pixels).any()
    np.testing.assert_allclose(window.predicted(np.eye(4), MOTION), expected, rtol=1e-12)


def test_the_median_shift_is_that_of_the_slow_twin(rays: FloatArray) -> None:
    now = rays + np.random.default_rng(2).normal(0, 0.02, rays.shape)
    for turn_rad, all_in_front in ((0.1, True), (1.4, False)):
        rotation = se3.exp(np.array([0, 0, 0, 0, turn_rad, 0]))[:3, :3]
        before = two_view.rotate_rays(rotation, rays)
        assert np.isfinite(before).all() == all_in_front
        expected = np.nanmedian(np.linalg.norm(now - before, axis=1))
        assert windowed_map._shift(rotation, rays, now) == pytest.approx(expected, rel=1e-12)
    assert np.isnan(windowed_map._shift(se3.exp(np.array([0, 0, 0, 0, np.pi, 0]))[:3, :3], rays, now))


def test_spread_is_that_of_the_slow_twin(rays: FloatArray) -> None:
    rng, poses = np.random.default_rng(3), np.stack([np.eye(4), MOTION, MOTION @ MOTION])
    views = rays + rng.normal(0, 0.05, (3, *rays.shape))
    views[rng.integers(0, 3, 200), np.arange(200)] = np.nan
    np.testing.assert_allclose(windowed_map._spread(views, poses), slow_spread(views, poses), rtol=1e-12)
