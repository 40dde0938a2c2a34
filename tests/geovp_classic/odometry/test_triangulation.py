"""Points from several views, against least squares point by point and against pycolmap."""

import numpy as np
import pycolmap

from geovp_classic.geometry import se3
from geovp_classic.odometry.triangulation import triangulate
from geovp_classic.types import FloatArray

POSES = np.stack([se3.exp(np.array([0, 0, -0.7 * i, 0, 0.01 * i, 0])) for i in range(4)])


def scene(seed: int, count: int) -> tuple[FloatArray, FloatArray]:
    """Points [N, 3] and their rays [V, N, 2] in all views."""
    rng = np.random.default_rng(seed)
    points = np.stack(
        [rng.uniform(-12, 12, count), rng.uniform(-4, 1.6, count), rng.uniform(6, 60, count)],
        axis=1,
    )
    cam = se3.transform(POSES, points)
    return points, cam[..., :2] / cam[..., 2:]


def triangulate_one_by_one(rays: FloatArray, num_rounds: int = 3) -> FloatArray:
    """Each point by least squares of (r_xy - ray r_z) . p = ray t_z - t_xy, over the depth of the
    round before.
    """
    found = np.full((rays.shape[1], 3), np.nan)
    for n in range(rays.shape[1]):
        views = np.flatnonzero(np.isfinite(rays[:, n, 0]))
        if len(views) < 2:
            continue
        rotation, translation, observed = POSES[views, :3, :3], POSES[views, :3, 3], rays[views, n]
        rows = rotation[:, :2] - observed[..., None] * rotation[:, 2:]
        right = observed * translation[:, 2:] - translation[:, :2]
        depth = np.ones(len(views))
        for _ in range(num_rounds):
            weighted = (rows / depth[:, None, None]).reshape(-1, 3)
            found[n] = np.linalg.lstsq(weighted, (right / depth[:, None]).ravel())[0]
            depth = np.abs(rotation[:, 2] @ found[n] + translation[:, 2])
    return found


def test_points_are_those_of_least_squares() -> None:
    rng, (_, rays) = np.random.default_rng(1), scene(0, 80)
    rays += rng.normal(0, 1e-3, rays.shape)
    rays[rng.uniform(size=rays.shape[:2]) < 0.3] = np.nan
    expected = triangulate_one_by_one(rays)
    assert 0 < np.isnan(expected[:, 0]).sum() < 20
    np.testing.assert_allclose(triangulate(rays, POSES), expected, rtol=1e-7)


def test_triangulation_is_exact_without_noise_and_says_what_it_cannot_place() -> None:
    points, seen = scene(3, 50)
    seen[1:, 0] = np.nan  # point 0 is seen once, point 1 twice
    seen[2:, 1] = np.nan
    found = triangulate(seen, POSES)
    assert np.isnan(found[0]).all()
    np.testing.assert_allclose(found[1:], points[1:], rtol=1e-6, atol=1e-6)


def test_without_noise_pycolmap_finds_the_same_points() -> None:
    _, rays = scene(4, 20)
    directions = np.concatenate([rays, np.ones((4, 20, 1))], axis=-1)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    expected = [
        pycolmap.triangulate_multi_view_point(list(POSES[:, :3]), directions[:, n])
        for n in range(20)
    ]
    np.testing.assert_allclose(triangulate(rays, POSES), np.reshape(expected, (20, 3)), rtol=1e-5)
