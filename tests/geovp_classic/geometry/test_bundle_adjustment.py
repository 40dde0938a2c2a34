"""Bundle adjustment against numerical derivatives and a general least-squares solver."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.bundle_adjustment import (
    Bundle,
    BundleAdjustment,
    PosePrior,
)
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(120.0, 120.0, 63.5, 55.0, 128, 112)


def drive(num_sources: int) -> FloatArray:
    """Return poses [S, 4, 4] of a straight drive, source from reference, the last frame."""
    steps = np.arange(num_sources, 0, -1)[:, None]
    return se3.exp(steps * np.array([0, 0, 0.8, 0, 0, 0]))


def bundle_of(poses: FloatArray, num: int = 150, noise_px: float = 0.1) -> Bundle:
    """Return noisy projections of random points with the true poses and inverse depths."""
    rng = np.random.default_rng(3)
    pixels = rng.uniform([5, 5], [122, 106], (num, 2))
    inverse_depth = 1 / rng.uniform(5, 40, num)
    rays = pinhole.unproject(pixels, np.ones(num), CAMERA)
    points = np.concatenate([rays, inverse_depth[:, None]], axis=1)
    projections, _ = pinhole.project(points @ np.swapaxes(poses[:, :3], -1, -2), CAMERA)
    projections += rng.normal(0, noise_px, projections.shape)
    is_visible = np.ones(projections.shape[:2], dtype=bool)
    return Bundle(poses, rays, inverse_depth, projections, is_visible, CAMERA)


def prior_of(given: FloatArray) -> PosePrior:
    """Return a prior of 1 mm and 0.17 mrad."""
    precision = 1 / np.repeat([[1e-3, 1.7e-4]], [3, 3], axis=1)
    return PosePrior(given, np.repeat(precision, len(given), axis=0), scale=5.5)


def adjust(bundle: Bundle, given: FloatArray) -> FloatArray:
    solver = BundleAdjustment(max_rounds=30, min_decrease=1e-7)
    start = replace(bundle, cam_from_world=given).with_inverse_depths()
    return solver.adjust(start, prior_of(given)).cam_from_world


def test_derivatives_are_those_of_the_errors() -> None:
    poses = drive(3)
    bundle = bundle_of(poses)
    bundle.is_visible[:, ::5] = False
    poses[2, 2, 3] = -15.0  # some points lie behind this camera
    _, by_camera, by_depth = bundle.linearise()
    derivatives = np.concatenate([by_camera, by_depth[..., None]], axis=-1)
    size = 1e-6

    def errors(step: FloatArray) -> FloatArray:
        poses = se3.exp(step[:6]) @ bundle.cam_from_world
        depths = bundle.inverse_depths + step[6]
        return replace(bundle, cam_from_world=poses, inverse_depths=depths).linearise()[0]

    for k, step in enumerate(size * np.eye(7)):
        numerical = (errors(step) - errors(-step)) / (2 * size)
        np.testing.assert_allclose(derivatives[..., k], numerical, rtol=1e-4, atol=1e-3)
    assert not derivatives[:, ::5].any()


@pytest.mark.parametrize("scale", [1.0, 20.0])
def test_the_robust_cost_is_minimal(scale: float) -> None:
    # Given poses are off by about one or by about twenty standard deviations.
    truth = drive(3)
    bundle = bundle_of(truth, num=25)
    bundle.pixels[0, :4] += 8.0  # outliers
    deviation = np.array([1e-3] * 3 + [1.7e-4] * 3)
    given = se3.exp(scale * np.random.default_rng(0).normal(0, 1, (3, 6)) * deviation) @ truth

    def roots(parameters: FloatArray) -> FloatArray:
        """Return the roots of the terms of the cost."""
        twists = parameters[:18].reshape(3, 6)
        poses = se3.exp(twists) @ given
        moved = replace(bundle, cam_from_world=poses, inverse_depths=parameters[18:])
        squares = (moved.linearise()[0] ** 2).sum(axis=-1).ravel() / 0.5**2
        prior_term = 5.5**2 * np.log1p(((twists / deviation) ** 2).sum() / 5.5**2)
        return np.sqrt(np.append(np.log1p(squares), prior_term) + 1e-12)

    depths = replace(bundle, cam_from_world=given).with_inverse_depths().inverse_depths
    start = np.concatenate([np.zeros(18), depths])
    expected = least_squares(roots, start, x_scale="jac").x[:18].reshape(3, 6)
    moved = se3.log(adjust(bundle, given) @ se3.inverse(given))
    np.testing.assert_allclose(moved / deviation, expected / deviation, atol=0.1)


def test_poses_that_fit_stay_nearly_where_they_are_in_any_unit() -> None:
    truth = drive(5)
    half = truth.copy()
    half[:, :3, 3] /= 2  # fits the same images
    for given in (truth, half):
        moved = se3.log(adjust(bundle_of(truth), given) @ se3.inverse(given))
        assert np.rad2deg(np.abs(moved[:, 3:])).max() < 0.02
        assert np.abs(moved[:, :3]).max() < 0.01


def test_exact_pixels_give_exact_inverse_depths() -> None:
    bundle = bundle_of(drive(5), noise_px=0.0)
    start = replace(bundle, inverse_depths=np.zeros(len(bundle.rays))).with_inverse_depths()
    np.testing.assert_allclose(start.inverse_depths, bundle.inverse_depths, atol=1e-9)
