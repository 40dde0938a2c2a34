"""Local bundle adjustment against numerical derivatives and a general least-squares solver."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from geovp_classic.geometry import pinhole, se3
from geovp_classic.pose_refinement.local_bundle import Corners, LocalBundle
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(120.0, 120.0, 63.5, 55.0, 128, 112)
BUNDLE = LocalBundle()


def drive(num_sources: int) -> FloatArray:
    """Return poses [S, 4, 4] of a straight drive, source from reference, the last frame."""
    steps = np.arange(num_sources, 0, -1)[:, None]
    return se3.exp(steps * np.array([0, 0, 0.8, 0, 0, 0]))


def corners_of(poses: FloatArray, num: int = 150, noise_px: float = 0.1) -> Corners:
    """Return noisy projections of random points with the true poses."""
    rng = np.random.default_rng(3)
    pixels = rng.uniform([5, 5], [122, 106], (num, 2))
    points = pinhole.unproject(pixels, rng.uniform(5, 40, num), CAMERA)
    projections, _ = pinhole.project(se3.transform(poses, points), CAMERA)
    projections += rng.normal(0, noise_px, projections.shape)
    rays = pinhole.unproject(pixels, np.ones(num), CAMERA)
    return Corners(rays, projections, np.ones(projections.shape[:2], dtype=bool), CAMERA)


def test_derivatives_are_those_of_the_errors() -> None:
    poses = drive(3)
    corners = corners_of(poses)
    corners.is_visible[:, ::5] = False
    poses[2, 2, 3] = -15.0  # some points lie behind this camera
    inverse_depth = corners.triangulate(poses)
    _, by_twist, by_depth = corners.linearise(poses, inverse_depth)
    step = 1e-6

    def errors(twist: FloatArray, change: float) -> FloatArray:
        return corners.linearise(se3.exp(twist) @ poses, inverse_depth + change)[0]

    for k, twist in enumerate(step * np.eye(6)):
        numerical = (errors(twist, 0) - errors(-twist, 0)) / (2 * step)
        np.testing.assert_allclose(by_twist[..., k], numerical, rtol=1e-4, atol=1e-3)
    numerical = (errors(np.zeros(6), step) - errors(np.zeros(6), -step)) / (2 * step)
    np.testing.assert_allclose(by_depth, numerical, rtol=1e-4, atol=1e-3)
    assert not by_depth[:, ::5].any()


@pytest.mark.parametrize("scale", [1.0, 20.0])
def test_the_robust_cost_is_minimal(scale: float) -> None:
    # Given poses are off by about one or by about twenty standard deviations.
    truth = drive(3)
    corners = corners_of(truth, num=25)
    corners.pixels[0, :4] += 8.0  # outliers
    deviation = np.array([1e-3] * 3 + [1.7e-4] * 3)
    rng = np.random.default_rng(0)
    given = se3.exp(scale * rng.normal(0, 1, (3, 6)) * deviation) @ truth
    distance = np.linalg.norm(given[:, :3, 3], axis=1)[:, None]
    deviations = np.repeat([[7e-4, 1.7e-4]], 3, axis=1) * np.hstack(
        [distance] * 3 + [distance**0] * 3
    )

    def roots(parameters: FloatArray) -> FloatArray:
        """Return the roots of the terms of the cost."""
        twists = parameters[:18].reshape(3, 6)
        poses = se3.exp(twists) @ given
        errors = corners.linearise(poses, parameters[18:])[0]
        squares = (errors**2).sum(axis=-1).ravel() / BUNDLE.error_scale_px**2
        prior = BUNDLE.prior_scale**2
        prior_term = prior * np.log1p(((twists / deviations) ** 2).sum() / prior)
        return np.sqrt(np.append(np.log1p(squares), prior_term) + 1e-12)

    start = np.concatenate([np.zeros(18), corners.triangulate(given)])
    expected = least_squares(roots, start, x_scale="jac").x[:18].reshape(3, 6)
    adjusted = LocalBundle(num_rounds=30, min_step=1e-6).adjust(corners, given)
    moved = se3.log(adjusted @ se3.inverse(given))
    np.testing.assert_allclose(moved / deviations, expected / deviations, atol=0.1)


def test_poses_that_fit_stay_nearly_where_they_are() -> None:
    truth = drive(5)
    adjusted = BUNDLE.adjust(corners_of(truth), truth)
    moved = se3.log(adjusted @ se3.inverse(truth))
    assert np.rad2deg(np.abs(moved[:, 3:])).max() < 0.02
    assert np.abs(moved[:, :3]).max() < 0.01


def test_the_unit_is_that_of_the_given_poses() -> None:
    # Poses half as long fit the same images: nothing says that they are wrong.
    truth = drive(5)
    half = truth.copy()
    half[:, :3, 3] /= 2
    moved = se3.log(BUNDLE.adjust(corners_of(truth), half) @ se3.inverse(half))
    assert np.abs(moved[:, :3]).max() < 0.01


def test_exact_corners_triangulate_exactly() -> None:
    poses = drive(5)
    corners = corners_of(poses, noise_px=0.0)
    errors, _, _ = corners.linearise(poses, corners.triangulate(poses))
    assert np.abs(errors).max() < 1e-6
