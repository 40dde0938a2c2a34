"""Radial distortion: estimated in turns, and unchanged on straight roads."""

from dataclasses import replace

import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import homogeneous, sampson_terms
from geovp_classic.odometry.lens import Lens, undistort
from geovp_classic.odometry.self_calibration import RadialEstimate, radial_derivative
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(700.0, 700.0, 620.0, 180.0, 1240, 370)
NOISE = 0.1 / 700


def observations(
    radial: float, now_from_before: FloatArray, seed: int, count: int = 300
) -> tuple[FloatArray, FloatArray]:
    """Return rays [N, 2] of random points in two images through a lens, with noise."""
    rng, lens = np.random.default_rng(seed), Lens(CAMERA, radial)
    rays = np.stack([rng.uniform(-0.8, 0.8, count), rng.uniform(-0.25, 0.25, count)], axis=1)
    points = homogeneous(rays) * rng.uniform(6, 50, count)[:, None]
    views = []
    for cam_from_world in (np.eye(4), now_from_before):
        cam = se3.transform(cam_from_world, points)
        views.append(
            lens.distorted_rays(lens.pixels(cam[:, :2] / cam[:, 2:]))
            + rng.normal(0, NOISE, (count, 2))
        )
    return views[0], views[1]


def estimate(radial: float, turn_deg: float, count: int = 12) -> RadialEstimate:
    now_from_before = se3.inverse(se3.exp(np.array([0, 0, 0.8, 0, np.radians(turn_deg), 0])))
    estimated = RadialEstimate()
    for seed in range(count):
        estimated = estimated.updated(
            *observations(radial, now_from_before, seed), now_from_before, NOISE
        )
    return estimated


@pytest.mark.parametrize("radial", [-0.015, 0.0, 0.01])
def test_a_turn_determines_the_distortion(radial: float) -> None:
    estimated = estimate(radial, turn_deg=4.0)
    assert estimated.mean == pytest.approx(radial, abs=0.002)
    assert abs(estimated.mean - radial) < 3 * np.sqrt(estimated.variance) + 5e-4
    assert estimated.variance < 0.003**2


def test_a_straight_road_is_uninformative() -> None:
    assert estimate(-0.015, turn_deg=1.0) == RadialEstimate()


def test_few_points_or_no_motion_are_uninformative() -> None:
    now_from_before = se3.inverse(se3.exp(np.array([0, 0, 0.8, 0, 0.07, 0])))
    a, b = observations(-0.015, now_from_before, 0)
    assert RadialEstimate().updated(a[:40], b[:40], now_from_before, NOISE) == RadialEstimate()
    still = se3.compose(now_from_before[:3, :3], np.zeros(3))
    assert RadialEstimate().updated(a, b, still, NOISE) == RadialEstimate()


def test_the_derivative_by_distortion_is_that_of_differences() -> None:
    """Distances are those of the distorted pixels: of the undistorted ones over the stretch."""
    now_from_before = se3.inverse(se3.exp(np.array([0.1, 0.05, 1.0, 0.01, 0.07, -0.02])))
    a, b = observations(0.01, now_from_before, 0)
    radial, tiny = 0.0, 1e-6

    def algebraic(value: float) -> FloatArray:
        terms = sampson_terms(undistort(a, value), undistort(b, value), now_from_before)
        return terms.distance * terms.gradient

    terms = sampson_terms(undistort(a, radial), undistort(b, radial), now_from_before)
    terms = replace(terms, distance=np.zeros(len(a)))  # the linear part alone
    expected = (algebraic(tiny) - algebraic(-tiny)) / (2 * tiny) / terms.gradient
    derivative = radial_derivative(a, b, terms)
    np.testing.assert_allclose(derivative, expected, atol=1e-6 * np.abs(expected).max())
