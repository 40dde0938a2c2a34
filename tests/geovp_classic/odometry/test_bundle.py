"""Resection, bundle adjustment and the window of keyframes, on points whose place is known."""

import numpy as np
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
    return np.stack([rng.uniform(-8, 8, count), rng.uniform(-3, 1.6, count), rng.uniform(8, 40, count)], axis=1)


def seen(points: FloatArray, cam_from_world: FloatArray) -> FloatArray:
    cam = se3.transform(cam_from_world, points)
    return LENS.pixels(cam[..., :2] / cam[..., 2:])


def path(count: int) -> FloatArray:
    return np.stack([se3.exp(np.array([0, 0, -0.6 * i, 0, 0.005 * i, 0])) for i in range(count)])


def test_resection_from_a_poor_guess_is_exact_without_noise() -> None:
    points, truth = scene(), se3.exp(np.array([0.2, -0.1, -1.5, 0.02, -0.05, 0.01]))
    found, inliers = resection.resect(points, LENS.rays(seen(points, truth)), np.eye(4), NOISE)
    np.testing.assert_allclose(found, truth, atol=1e-4)
    assert inliers.all()


def test_resection_survives_half_wrong_points() -> None:
    points, truth = scene(), se3.exp(np.array([0.2, -0.1, -1.5, 0.02, -0.05, 0.01]))
    rays = LENS.rays(seen(points, truth))
    rays[:60] += np.random.default_rng(1).uniform(-0.3, 0.3, (60, 2))
    found, inliers = resection.resect(points, rays, np.eye(4), NOISE)
    np.testing.assert_allclose(found, truth, atol=1e-3)
    assert inliers[60:].all()
    assert inliers[:60].mean() < 0.1


def test_resection_of_too_few_points_is_the_guess() -> None:
    guess = se3.exp(np.array([1.0, 0, 0, 0, 0, 0]))
    found, inliers = resection.resect(scene(3), np.zeros((3, 2)), guess, NOISE)
    np.testing.assert_array_equal(found, guess)
    assert not inliers.any()


def test_misses_by_hand_and_behind() -> None:
    points = np.array([[1.0, 0, 10], [0, 0, -5]])
    missed = resection.misses(points, np.array([[0.1, 0.03], [0, 0]]), np.eye(4))
    np.testing.assert_allclose(missed, [0.03, np.inf])


def slow_equations(
    points: FloatArray, rays: FloatArray, pose: FloatArray, kernel: float
) -> tuple[FloatArray, FloatArray, float, FloatArray]:
    """Normal equations with Cauchy weights, the kernel, and slopes [N, 2, 6] of the rays; all by differences."""
    tiny = 1e-6

    def places(twist: FloatArray) -> FloatArray:
        cam = se3.transform(se3.exp(twist) @ pose, points)
        return cam[:, :2] / cam[:, 2:]

    slopes = np.stack([(places(tiny * axis) - places(-tiny * axis)) / (2 * tiny) for axis in np.eye(6)], axis=-1)
    front = se3.transform(pose, points)[:, 2] > 0
    residual = places(np.zeros(6)) - rays
    distance = np.where(front, np.linalg.norm(residual, axis=1), np.inf)
    kernel = max(NOISE, min(float(np.median(distance)), kernel / 2))
    weight = 1 / (1 + (distance / kernel) ** 2)
    normal = np.einsum("n,nki,nkj->ij", weight, slopes, slopes)
    return normal, np.einsum("n,nki,nk->i", weight, slopes, residual), kernel, slopes


@pytest.mark.parametrize("kernel", [np.inf, 1e-3])
def test_equations_of_the_resection_are_those_of_the_slow_twin(kernel: float) -> None:
    points, truth = scene(), se3.exp(np.array([0.2, -0.1, -12.0, 0.02, -0.05, 0.01]))
    pose = se3.exp(np.array([0.01, 0.02, 0.0, 0.004, 0, -0.003])) @ truth
    rays = LENS.rays(seen(points, truth))
    assert 0 < (se3.transform(pose, points)[:, 2] < 0).mean() < 0.5
    normal, moment, used = resection._equations(points, rays, pose, kernel, NOISE)
    expected_normal, expected_moment, expected, _ = slow_equations(points, rays, pose, kernel)
    assert used == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(normal, expected_normal, rtol=1e-4, atol=1e-6 * np.abs(expected_normal).max())
    np.testing.assert_allclose(moment, expected_moment, rtol=1e-4, atol=1e-6 * np.abs(expected_moment).max())


def test_the_mean_shift_is_that_of_the_slow_twin() -> None:
    points, pose, step = scene(), path(3)[2], np.array([0.1, -0.2, 0.3, 0.01, 0.02, -0.03])
    slopes = slow_equations(points, np.zeros((len(points), 2)), pose, 1.0)[3]
    assert resection._mean_shift(points, pose, step) == pytest.approx(np.abs(slopes @ step).mean(), rel=1e-6)


def test_bundle_adjustment_mends_poses_and_points_and_keeps_what_is_fixed() -> None:
    points, poses, rng = scene(), path(5), np.random.default_rng(2)
    pixels = np.stack([seen(points, pose) for pose in poses])
    pixels[3, :40] = np.nan
    shaken = poses.copy()
    shaken[2:] = se3.exp(rng.normal(0, 0.01, (3, 6))) @ poses[2:]
    moved_poses, moved = bundle_adjust(shaken, points + rng.normal(0, 0.1, points.shape), pixels, LENS)
    np.testing.assert_array_equal(moved_poses[:2], poses[:2])
    np.testing.assert_allclose(moved_poses, poses, atol=1e-3)
    assert np.median(np.linalg.norm(moved - points, axis=1)) < 0.01


def test_bundle_adjustment_is_deterministic_and_shrugs_off_outliers() -> None:
    points, poses = scene(), path(4)
    pixels = np.stack([seen(points, pose) for pose in poses])
    pixels[2, :10] += 30
    results = [bundle_adjust(poses, points, pixels, LENS) for _ in range(2)]
    np.testing.assert_array_equal(results[0][0], results[1][0])
    np.testing.assert_allclose(results[0][0], poses, atol=5e-3)


def test_one_fixed_keyframe_keeps_the_length_of_a_baseline() -> None:
    points, poses = scene(), path(4)
    pixels = np.stack([seen(points, pose) for pose in poses])
    shaken = poses.copy()
    shaken[1:] = se3.exp(np.random.default_rng(3).normal(0, 0.003, (3, 6))) @ poses[1:]
    moved, _ = bundle_adjust(shaken, points, pixels, LENS, num_fixed=1)
    np.testing.assert_array_equal(moved[0], poses[0])
    lengths = np.linalg.norm(se3.inverse(moved)[1:, :3, 3], axis=1)
    np.testing.assert_allclose(lengths / lengths[0], [1, 2, 3], rtol=0.01)


def test_lens_goes_there_and_back() -> None:
    bent = Lens(CAMERA, radial=-0.015)
    pixels = np.random.default_rng(0).uniform([0, 0], [1240, 370], (100, 2))
    np.testing.assert_allclose(bent.pixels(bent.rays(pixels)), pixels, atol=1e-3)
    # at the right edge the ray is (1240 - 600) / 700 = 0.914: it shrinks by 1.5 % of 0.914^2
    assert bent.rays(np.array([1240.0, 170.0]))[0] == pytest.approx(0.914286 * (1 - 0.015 * 0.835918), abs=1e-5)


def filled(window: int = 3, frames: int = 5) -> tuple[WindowedMap, FloatArray]:
    points, kept = scene(), WindowedMap(LENS, 0.25, window)
    for i, pose in enumerate(path(frames)):
        if i:
            kept.pixels[:] = seen(points, pose)
        kept.insert(pose)
        if i == 0:
            kept.add(seen(points, pose))
        kept.place()
    return kept, points


def test_the_map_places_points_and_keeps_a_window_of_keyframes() -> None:
    kept, points = filled()
    assert (len(kept), kept.first_serial, kept.newest_serial) == (3, 2, 4)
    assert kept.seen.shape == (3, 120, 2)
    assert kept.known.mean() > 0.9
    np.testing.assert_allclose(kept.points[kept.known], points[kept.known], rtol=1e-4, atol=1e-4)


def test_the_map_foretells_where_points_appear() -> None:
    kept, points = filled()
    ahead = se3.exp(np.array([0, 0, -3.0, 0, 0.03, 0]))
    foretold = kept.predicted(path(5)[-1], ahead)
    known = kept.known
    np.testing.assert_allclose(foretold[known], seen(points, ahead)[known], atol=0.05)
    # unknown points are as far as their neighbours: better than not moving at all
    kept.points[::4] = np.nan
    guessed, truth = kept.predicted(path(5)[-1], ahead)[::4], seen(points, ahead)[::4]
    assert np.median(np.linalg.norm(guessed - truth, axis=1)) < np.median(
        np.linalg.norm(kept.pixels[::4] - truth, axis=1)
    )


def test_points_that_do_not_fit_are_culled() -> None:
    kept, _ = filled()
    kept.seen[1:, 0] += 40
    kept.cull()
    assert not kept.known[0]
    assert not kept.followed[0]
    assert kept.known[1:].mean() > 0.9


def test_ids_find_points_again_after_others_are_gone() -> None:
    kept, _ = filled()
    kept.followed[::2] = False
    ids = kept.ids.copy()
    kept.keep_newest_only()
    kept.insert(path(6)[-1])
    place = kept.index_of(ids)
    assert (place[::2] == -1).all()
    np.testing.assert_array_equal(kept.ids[place[1::2]], ids[1::2])
    kept.clear()
    assert (len(kept), len(kept.points)) == (0, 0)
    assert (kept.index_of(ids) == -1).all()


def test_parallax_ignores_rotation() -> None:
    kept, points = filled()
    turned = se3.exp(np.array([0, 0, 0, 0, 0.05, 0])) @ path(5)[-1]
    kept.pixels[:] = seen(points, turned)
    assert kept.parallax(turned) < 1e-6
