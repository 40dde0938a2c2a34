"""A camera that turns learns its lens; one that drives straight on keeps what it believed."""

import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import homogeneous
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.self_calibration import RadialEstimate, linearised
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(700.0, 700.0, 620.0, 180.0, 1240, 370)
NOISE = 0.1 / 700


def observations(
    radial: float, now_from_before: FloatArray, seed: int, count: int = 300
) -> tuple[FloatArray, FloatArray]:
    """Rays [N, 2] of random points in two images through a lens with this distortion, with noise."""
    rng, lens = np.random.default_rng(seed), Lens(CAMERA, radial)
    rays = np.stack([rng.uniform(-0.8, 0.8, count), rng.uniform(-0.25, 0.25, count)], axis=1)
    points = (
        np.concatenate([rays, np.ones((count, 1))], axis=1) * rng.uniform(6, 50, count)[:, None]
    )
    views = []
    for cam_from_world in (np.eye(4), now_from_before):
        cam = se3.transform(cam_from_world, points)
        views.append(
            lens.distorted_rays(lens.pixels(cam[:, :2] / cam[:, 2:]))
            + rng.normal(0, NOISE, (count, 2))
        )
    return views[0], views[1]


def learnt(radial: float, turn_deg: float, count: int = 12) -> RadialEstimate:
    now_from_before = se3.inverse(se3.exp(np.array([0, 0, 0.8, 0, np.radians(turn_deg), 0])))
    belief = RadialEstimate()
    for seed in range(count):
        belief = belief.updated(
            *observations(radial, now_from_before, seed), now_from_before, NOISE
        )
    return belief


@pytest.mark.parametrize("radial", [-0.015, 0.0, 0.01])
def test_a_street_corner_teaches_the_distortion(radial: float) -> None:
    belief = learnt(radial, turn_deg=4.0)
    assert belief.mean == pytest.approx(radial, abs=0.002)
    assert abs(belief.mean - radial) < 3 * np.sqrt(belief.variance) + 5e-4
    assert belief.variance < 0.003**2


def test_driving_straight_on_teaches_nothing() -> None:
    assert learnt(-0.015, turn_deg=1.0) == RadialEstimate()


def test_few_points_or_no_motion_teach_nothing() -> None:
    now_from_before = se3.inverse(se3.exp(np.array([0, 0, 0.8, 0, 0.07, 0])))
    a, b = observations(-0.015, now_from_before, 0)
    assert RadialEstimate().updated(a[:40], b[:40], now_from_before, NOISE) == RadialEstimate()
    still = se3.compose(now_from_before[:3, :3], np.zeros(3))
    assert RadialEstimate().updated(a, b, still, NOISE) == RadialEstimate()


def slow_linearised(
    distorted_a: FloatArray,
    distorted_b: FloatArray,
    b_from_a: FloatArray,
    across: FloatArray,
    radial: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sampson distances of all pairs at once, and their derivatives by motion and lens."""
    square_a, square_b = (distorted_a**2).sum(axis=1), (distorted_b**2).sum(axis=1)
    a = homogeneous(distorted_a * (1 + radial * square_a)[:, None])
    b = homogeneous(distorted_b * (1 + radial * square_b)[:, None])
    rotation, direction = b_from_a[:3, :3], b_from_a[:3, 3]
    turned, essential = a @ rotation.T, se3.cross_matrix(direction) @ rotation
    line_b, line_a = (a @ essential.T)[:, :2], (b @ essential)[:, :2]
    steep_a, steep_b = (line_a**2).sum(axis=1), (line_b**2).sum(axis=1)
    gradient = np.sqrt(steep_a + steep_b)
    residual = (b @ essential * a).sum(axis=1) / gradient
    by_rotation = np.cross(turned, np.cross(b, direction))
    by_motion = (
        np.concatenate([by_rotation, np.cross(turned, b) @ across.T], axis=1) / gradient[:, None]
    )
    along_a, along_b = (distorted_a * line_a).sum(axis=1), (distorted_b * line_b).sum(axis=1)
    stretched = square_a * steep_a + 2 * along_a**2 + square_b * steep_b + 2 * along_b**2
    by_radial = (
        square_a * along_a + square_b * along_b
    ) / gradient - residual * stretched / gradient**2
    return residual, by_motion, by_radial


def test_distances_and_derivatives_are_those_of_the_formulas() -> None:
    now_from_before = se3.inverse(se3.exp(np.array([0.1, 0.05, 1.0, 0.01, 0.07, -0.02])))
    a, b = observations(0.01, now_from_before, 0)
    across = np.linalg.svd(now_from_before[None, :3, 3])[2][1:]
    found, formulas = (
        linearised(a, b, now_from_before, 0.02),
        slow_linearised(a, b, now_from_before, across, 0.02),
    )
    for values, expected in zip(found, formulas, strict=True):
        np.testing.assert_allclose(values, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())
