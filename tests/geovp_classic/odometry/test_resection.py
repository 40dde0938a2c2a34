"""Pose of a camera that observes known points."""

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.odometry.resection import Resection
from geovp_classic.odometry.triangulation import reprojection_errors
from geovp_classic.types import FloatArray
from tests.geovp_classic.odometry.known_points import CAMERA, project, scene

NOISE = 0.25 / CAMERA.fx_px
TRUTH = se3.exp(np.array([0.2, -0.1, -1.5, 0.02, -0.05, 0.01]))


def resect(points: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    return Resection().resect(points, rays, np.eye(4), NOISE)


def test_resection_from_a_poor_guess_is_exact_without_noise() -> None:
    points = scene()
    pose, inliers = resect(points, pinhole.normalised(project(points, TRUTH), CAMERA))
    np.testing.assert_allclose(pose, TRUTH, atol=1e-4)
    assert inliers.all()


def test_resection_survives_half_wrong_points() -> None:
    points = scene()
    rays = pinhole.normalised(project(points, TRUTH), CAMERA)
    rays[:60] += np.random.default_rng(1).uniform(-0.3, 0.3, (60, 2))
    pose, inliers = resect(points, rays)
    np.testing.assert_allclose(pose, TRUTH, atol=1e-3)
    assert inliers[60:].all()
    assert inliers[:60].mean() < 0.1


def test_too_few_or_random_points_have_no_pose() -> None:
    points = scene()
    rays = np.random.default_rng(0).uniform(-0.5, 0.5, (len(points), 2))
    assert Resection().resect(points, rays, np.eye(4), NOISE) is None
    assert Resection().resect(points[:11], rays[:11], np.eye(4), NOISE) is None


def test_reprojection_errors_by_hand_and_behind() -> None:
    points = np.array([[1.0, 0, 10], [0, 0, -5]])
    errors = reprojection_errors(points, np.array([[0.1, 0.03], [0, 0]]), np.eye(4))
    np.testing.assert_allclose(errors, [0.03, np.inf])
