"""Bundle adjustment of points and poses that are known, without and with a prior."""

import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.geometry.bundle_adjustment import AnchoredAdjustment, bundle_adjust
from tests.geovp_classic.odometry.known_points import CAMERA, path, project, scene


def test_bundle_adjustment_corrects_poses_and_points_and_keeps_what_is_fixed() -> None:
    points, poses, rng = scene(), path(5), np.random.default_rng(2)
    pixels = project(points, poses)
    pixels[3, :40] = np.nan
    perturbed = poses.copy()
    perturbed[2:] = se3.exp(rng.normal(0, 0.01, (3, 6))) @ poses[2:]
    moved_poses, moved = bundle_adjust(
        perturbed, points + rng.normal(0, 0.1, points.shape), pixels, CAMERA
    )
    np.testing.assert_array_equal(moved_poses[:2], poses[:2])
    np.testing.assert_allclose(moved_poses, poses, atol=1e-3)
    assert np.median(np.linalg.norm(moved - points, axis=1)) < 0.01


def test_bundle_adjustment_ignores_outliers() -> None:
    points, poses = scene(), path(4)
    pixels = project(points, poses)
    pixels[2, :10] += 30
    adjusted, _ = bundle_adjust(poses, points, pixels, CAMERA)
    np.testing.assert_allclose(adjusted, poses, atol=5e-3)


def test_one_fixed_keyframe_keeps_the_length_of_a_baseline() -> None:
    points, poses = scene(), path(4)
    pixels = project(points, poses)
    perturbed = poses.copy()
    perturbed[1:] = se3.exp(np.random.default_rng(3).normal(0, 0.003, (3, 6))) @ poses[1:]
    moved, _ = bundle_adjust(perturbed, points, pixels, CAMERA, num_fixed=1)
    np.testing.assert_array_equal(moved[0], poses[0])
    lengths = np.linalg.norm(se3.inverse(moved)[1:, :3, 3], axis=1)
    np.testing.assert_allclose(lengths / lengths[0], [1, 2, 3], rtol=0.01)


@pytest.mark.parametrize("unit", [1.0, 0.5])
def test_given_poses_that_fit_stay_in_their_unit(unit: float) -> None:
    points, poses = scene(), path(4)
    points = se3.transform(poses[0], points)
    given = poses @ se3.inverse(poses[0])
    rng = np.random.default_rng(4)
    pixels = project(points, given)
    pixels += rng.normal(0, 0.1, pixels.shape)
    given[:, :3, 3] *= unit
    moved = AnchoredAdjustment().adjust(given, unit * points, pixels, CAMERA)
    np.testing.assert_array_equal(moved[0], np.eye(4))
    deviation = np.abs(se3.log(moved @ se3.inverse(given)))
    assert np.rad2deg(deviation[:, 3:]).max() < 0.02
    assert deviation[:, :3].max() < 0.01 * unit


def test_a_given_pose_that_the_images_contradict_is_corrected() -> None:
    points, poses = scene(), path(4)
    points = se3.transform(poses[0], points)
    truth = poses @ se3.inverse(poses[0])
    pixels = project(points, truth)
    given = truth.copy()
    given[2] = se3.exp(np.array([0, 0, 0, 0, np.deg2rad(0.2), 0])) @ truth[2]
    moved = AnchoredAdjustment().adjust(given, points, pixels, CAMERA)
    assert np.rad2deg(se3.rotation_angle_rad(moved @ se3.inverse(truth))).max() < 0.02
