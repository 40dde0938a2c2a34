"""Resection, bundle adjustment and the window of keyframes, on points whose place is known."""

import subprocess
import sys

import numpy as np
import pycolmap
import pytest

from geovp_classic.geometry import se3
from geovp_classic.odometry import resection
from geovp_classic.odometry.bundle import bundle_adjust
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.windowed_map import WindowedMap
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(700.0, 705.0, 600.0, 170.0, 1240, 370)
LENS = Lens(CAMERA)
NOISE = 0.25 / LENS.focal_px


def scene(count: int = 120, seed: int = 0) -> FloatArray:
    rng = np.random.default_rng(seed)
    return np.stack(
        [rng.uniform(-8, 8, count), rng.uniform(-3, 1.6, count), rng.uniform(8, 40, count)], axis=1
    )


def project(points: FloatArray, cam_from_world: FloatArray) -> FloatArray:
    cam = se3.transform(cam_from_world, points)
    return LENS.pixels(cam[..., :2] / cam[..., 2:])


def path(count: int) -> FloatArray:
    return np.stack([se3.exp(np.array([0, 0, -0.6 * i, 0, 0.005 * i, 0])) for i in range(count)])


def test_resection_from_a_poor_guess_is_exact_without_noise() -> None:
    points, truth = scene(), se3.exp(np.array([0.2, -0.1, -1.5, 0.02, -0.05, 0.01]))
    found, inliers = resection.resect(points, LENS.rays(project(points, truth)), np.eye(4), NOISE)
    np.testing.assert_allclose(found, truth, atol=1e-4)
    assert inliers.all()


def test_resection_survives_half_wrong_points() -> None:
    points, truth = scene(), se3.exp(np.array([0.2, -0.1, -1.5, 0.02, -0.05, 0.01]))
    rays = LENS.rays(project(points, truth))
    rays[:60] += np.random.default_rng(1).uniform(-0.3, 0.3, (60, 2))
    found, inliers = resection.resect(points, rays, np.eye(4), NOISE)
    np.testing.assert_allclose(found, truth, atol=1e-3)
    assert inliers[60:].all()
    assert inliers[:60].mean() < 0.1


def test_resection_is_as_good_as_pycolmap() -> None:
    points, truth = scene(), se3.exp(np.array([0.2, -0.1, -1.5, 0.02, -0.05, 0.01]))
    rays = LENS.rays(project(points, truth)) + np.random.default_rng(4).normal(0, NOISE, (120, 2))
    found, _ = resection.resect(points, rays, np.eye(4), NOISE)
    camera = pycolmap.Camera(model="PINHOLE", width=2, height=2, params=[1.0, 1.0, 0.0, 0.0])
    options = pycolmap.AbsolutePoseRefinementOptions(
        loss_function_scale=NOISE, gradient_tolerance=1e-12
    )
    start = pycolmap.Rigid3d(pycolmap.Rotation3d(truth[:3, :3]), truth[:3, 3])
    refined = pycolmap.refine_absolute_pose(
        start, rays, points, np.ones(120, dtype=bool), camera, options
    )
    np.testing.assert_allclose(found[:3], refined["cam_from_world"].matrix(), atol=2e-4)


def test_resection_of_too_few_points_is_the_guess() -> None:
    guess = se3.exp(np.array([1.0, 0, 0, 0, 0, 0]))
    found, inliers = resection.resect(scene(3), np.zeros((3, 2)), guess, NOISE)
    np.testing.assert_array_equal(found, guess)
    assert not inliers.any()


def test_reprojection_errors_by_hand_and_behind() -> None:
    points = np.array([[1.0, 0, 10], [0, 0, -5]])
    errors = resection.reprojection_errors(points, np.array([[0.1, 0.03], [0, 0]]), np.eye(4))
    np.testing.assert_allclose(errors, [0.03, np.inf])


def slow_equations(
    points: FloatArray, rays: FloatArray, pose: FloatArray, kernel: float
) -> tuple[FloatArray, FloatArray, float]:
    """Normal equations with Cauchy weights, and the kernel; slopes by differences."""
    tiny = 1e-6

    def places(twist: FloatArray) -> FloatArray:
        cam = se3.transform(se3.exp(twist) @ pose, points)
        return cam[:, :2] / cam[:, 2:]

    slopes = np.stack(
        [(places(tiny * axis) - places(-tiny * axis)) / (2 * tiny) for axis in np.eye(6)], axis=-1
    )
    front = se3.transform(pose, points)[:, 2] > 0
    residual = places(np.zeros(6)) - rays
    distance = np.where(front, np.linalg.norm(residual, axis=1), np.inf)
    kernel = max(NOISE, min(float(np.median(distance)), kernel / 2))
    weight = 1 / (1 + (distance / kernel) ** 2)
    normal = np.einsum("n,nki,nkj->ij", weight, slopes, slopes)
    return normal, np.einsum("n,nki,nk->i", weight, slopes, residual), kernel


@pytest.mark.parametrize("kernel", [np.inf, 1e-3])
def test_equations_of_the_resection_are_those_of_differences(kernel: float) -> None:
    points, truth = scene(), se3.exp(np.array([0.2, -0.1, -12.0, 0.02, -0.05, 0.01]))
    pose = se3.exp(np.array([0.01, 0.02, 0.0, 0.004, 0, -0.003])) @ truth
    rays = LENS.rays(project(points, truth))
    assert 0 < (se3.transform(pose, points)[:, 2] < 0).mean() < 0.5
    normal, moment, used = resection._normal_equations(points, rays, pose, kernel, NOISE)
    expected_normal, expected_moment, expected = slow_equations(points, rays, pose, kernel)
    assert used == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(
        normal, expected_normal, rtol=1e-4, atol=1e-6 * np.abs(expected_normal).max()
    )
    np.testing.assert_allclose(
        moment, expected_moment, rtol=1e-4, atol=1e-6 * np.abs(expected_moment).max()
    )


def test_bundle_adjustment_corrects_poses_and_points_and_keeps_what_is_fixed() -> None:
    points, poses, rng = scene(), path(5), np.random.default_rng(2)
    pixels = np.stack([project(points, pose) for pose in poses])
    pixels[3, :40] = np.nan
    perturbed = poses.copy()
    perturbed[2:] = se3.exp(rng.normal(0, 0.01, (3, 6))) @ poses[2:]
    moved_poses, moved = bundle_adjust(
        perturbed, points + rng.normal(0, 0.1, points.shape), pixels, LENS
    )
    np.testing.assert_array_equal(moved_poses[:2], poses[:2])
    np.testing.assert_allclose(moved_poses, poses, atol=1e-3)
    assert np.median(np.linalg.norm(moved - points, axis=1)) < 0.01


def test_bundle_adjustment_is_deterministic_and_ignores_outliers() -> None:
    points, poses = scene(), path(4)
    pixels = np.stack([project(points, pose) for pose in poses])
    pixels[2, :10] += 30
    results = [bundle_adjust(poses, points, pixels, LENS) for _ in range(2)]
    np.testing.assert_array_equal(results[0][0], results[1][0])
    np.testing.assert_allclose(results[0][0], poses, atol=5e-3)


def test_one_fixed_keyframe_keeps_the_length_of_a_baseline() -> None:
    points, poses = scene(), path(4)
    pixels = np.stack([project(points, pose) for pose in poses])
    perturbed = poses.copy()
    perturbed[1:] = se3.exp(np.random.default_rng(3).normal(0, 0.003, (3, 6))) @ poses[1:]
    moved, _ = bundle_adjust(perturbed, points, pixels, LENS, num_fixed=1)
    np.testing.assert_array_equal(moved[0], poses[0])
    lengths = np.linalg.norm(se3.inverse(moved)[1:, :3, 3], axis=1)
    np.testing.assert_allclose(lengths / lengths[0], [1, 2, 3], rtol=0.01)


def test_lens_goes_there_and_back() -> None:
    bent = Lens(CAMERA, radial=-0.015)
    pixels = np.random.default_rng(0).uniform([0, 0], [1240, 370], (100, 2))
    np.testing.assert_allclose(bent.pixels(bent.rays(pixels)), pixels, atol=1e-3)
    # at the right edge the ray is (1240 - 600) / 700 = 0.914: it shrinks by 1.5 % of 0.914^2
    assert bent.rays(np.array([1240.0, 170.0]))[0] == pytest.approx(
        0.914286 * (1 - 0.015 * 0.835918), abs=1e-5
    )


def filled(size: int = 3, frames: int = 5) -> tuple[WindowedMap, FloatArray]:
    points, window = scene(), WindowedMap(LENS, 0.25, size)
    for i, pose in enumerate(path(frames)):
        if i:
            window.pixels[:] = project(points, pose)
        window.add_keyframe(pose)
        if i == 0:
            window.add_tracks(project(points, pose))
        window.triangulate()
    return window, points


def test_the_map_triangulates_points_and_keeps_a_window_of_keyframes() -> None:
    window, points = filled()
    assert (len(window), window.first_keyframe_id, window.newest_keyframe_id) == (3, 2, 4)
    assert window.observations.shape == (3, 120, 2)
    assert window.triangulated.mean() > 0.9
    np.testing.assert_allclose(
        window.points[window.triangulated], points[window.triangulated], rtol=1e-4, atol=1e-4
    )


def test_the_map_predicts_where_points_appear() -> None:
    window, points = filled()
    ahead = se3.exp(np.array([0, 0, -3.0, 0, 0.03, 0]))
    predicted = window.predict_pixels(path(5)[-1], ahead)
    known = window.triangulated
    np.testing.assert_allclose(predicted[known], project(points, ahead)[known], atol=0.05)
    # unknown points are as far as their neighbours: better than not moving at all
    window.points[::4] = np.nan
    guessed, truth = window.predict_pixels(path(5)[-1], ahead)[::4], project(points, ahead)[::4]
    assert np.median(np.linalg.norm(guessed - truth, axis=1)) < np.median(
        np.linalg.norm(window.pixels[::4] - truth, axis=1)
    )


def test_points_that_do_not_fit_are_culled() -> None:
    window, _ = filled()
    window.observations[1:, 0] += 40
    window.cull()
    assert not window.triangulated[0]
    assert not window.active[0]
    assert window.triangulated[1:].mean() > 0.9


def test_ids_find_tracks_after_others_are_removed() -> None:
    window, _ = filled()
    window.active[::2] = False
    ids = window.track_ids.copy()
    window.keep_newest_only()
    window.add_keyframe(path(6)[-1])
    place = window.index_of(ids)
    assert (place[::2] == -1).all()
    np.testing.assert_array_equal(window.track_ids[place[1::2]], ids[1::2])
    window.clear()
    assert (len(window), len(window.points)) == (0, 0)
    assert (window.index_of(ids) == -1).all()


def test_parallax_ignores_rotation() -> None:
    window, points = filled()
    turned = se3.exp(np.array([0, 0, 0, 0, 0.05, 0])) @ path(5)[-1]
    window.pixels[:] = project(points, turned)
    assert window.parallax(turned) < 1e-6


def test_a_program_that_is_asked_to_end_may_say_so_itself() -> None:
    said = "import os, signal, sys; signal.signal(signal.SIGTERM, lambda *_: sys.exit(7)); "
    said += (
        "import geovp_classic.odometry.bundle; os.kill(os.getpid(), signal.SIGTERM); signal.pause()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", said], capture_output=True, text=True, timeout=120
    )
    assert (ended.returncode, ended.stderr) == (7, "")
