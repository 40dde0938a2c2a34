"""Points from several views, exact and against pycolmap."""

import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.odometry.triangulation import reprojection_errors, triangulate
from geovp_classic.types import FloatArray
from tests.geovp_classic.odometry.known_points import CAMERA, path, project, scene

POSES = path(4)


def observed(seed: int) -> tuple[FloatArray, FloatArray]:
    """Points [N, 3] and their rays [V, N, 2] in all views."""
    points = scene(50, seed)
    return points, pinhole.normalised(project(points, POSES), CAMERA)


def test_triangulation_is_exact_without_noise_and_needs_two_views() -> None:
    points, rays = observed(3)
    rays[1:, 0] = np.nan  # point 0 has one observation, point 1 two
    rays[2:, 1] = np.nan
    triangulated = triangulate(rays, POSES)
    assert np.isnan(triangulated[0]).all()
    np.testing.assert_allclose(triangulated[1:], points[1:], rtol=1e-6, atol=1e-6)


def test_points_have_the_least_squared_errors() -> None:
    _, rays = observed(5)
    rays += np.random.default_rng(1).normal(0, 1e-4, rays.shape)
    points = triangulate(rays, POSES)

    def cost(moved: FloatArray) -> FloatArray:
        return np.asarray((reprojection_errors(moved, rays, POSES) ** 2).sum(axis=0))

    for step in np.concatenate([np.eye(3), -np.eye(3)]):
        assert (cost(points) < cost(points + 0.1 * step)).all()
