"""Points from several views, exact and against pycolmap."""

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.odometry.triangulation import reprojection_errors, triangulate
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


def test_triangulation_is_exact_without_noise_and_needs_two_views() -> None:
    points, rays = scene(3, 50)
    rays[1:, 0] = np.nan  # point 0 has one observation, point 1 two
    rays[2:, 1] = np.nan
    triangulated = triangulate(rays, POSES)
    assert np.isnan(triangulated[0]).all()
    np.testing.assert_allclose(triangulated[1:], points[1:], rtol=1e-6, atol=1e-6)


def test_points_have_the_least_squared_errors() -> None:
    _, rays = scene(5, 50)
    rays += np.random.default_rng(1).normal(0, 1e-4, rays.shape)
    points = triangulate(rays, POSES)

    def cost(moved: FloatArray) -> FloatArray:
        return np.asarray((reprojection_errors(moved, rays, POSES) ** 2).sum(axis=0))

    for step in np.concatenate([np.eye(3), -np.eye(3)]):
        assert (cost(points) < cost(points + 0.1 * step)).all()
