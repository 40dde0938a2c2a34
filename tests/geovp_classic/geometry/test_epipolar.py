"""Dense reprojection against points that are moved and projected one by one."""

import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(60.0, 66.0, 23.0, 20.0, 48, 40)
MOTION = se3.exp(np.array([0.3, -0.1, 0.8, 0.03, -0.05, 0.02]))


@pytest.fixture
def inverse_depth() -> FloatArray:
    return np.random.default_rng(0).uniform(0, 0.5, (40, 48)).astype(np.float32)


def slowly_seen(inverse_depth: FloatArray) -> FloatArray:
    """Pixels [H, W, 2] in the other camera, by points in space; infinity as very far."""
    points = pinhole.rays(CAMERA) / np.maximum(inverse_depth, 1e-7)[..., None]
    return pinhole.project(se3.transform(MOTION, points.reshape(-1, 3)), CAMERA)[0].reshape(
        40, 48, 2
    )


def test_places_are_those_of_points_in_space(inverse_depth: FloatArray) -> None:
    pixels, _ = Epipolar.of(CAMERA, MOTION).project(inverse_depth)
    np.testing.assert_allclose(pixels, slowly_seen(inverse_depth), atol=2e-3)


def test_what_is_behind_is_far_outside() -> None:
    backward = se3.exp(np.array([0, 0, -10.0, 0, 0, 0]))
    pixels, ratio = Epipolar.of(CAMERA, backward).project(
        np.full((40, 48), 0.2, np.float32)
    )  # at z = 5 - 10
    assert ((pixels < -100) | (pixels > 100)).any(axis=-1).all()
    np.testing.assert_allclose(ratio, -1)  # 5 m behind, over 5 m before


def test_another_camera_sees_the_same_points_at_its_own_pixels(inverse_depth: FloatArray) -> None:
    other = Intrinsics(30.0, 40.0, 12.0, 9.0, 24, 20)
    mine, ratio = Epipolar.of(CAMERA, MOTION).project(inverse_depth)
    pixels, same = Epipolar.of(CAMERA, MOTION, other).project(inverse_depth)
    np.testing.assert_allclose(pixels[..., 0], (mine[..., 0] - 23) / 60 * 30 + 12, atol=1e-3)
    np.testing.assert_allclose(pixels[..., 1], (mine[..., 1] - 20) / 66 * 40 + 9, atol=1e-3)
    np.testing.assert_allclose(same, ratio, rtol=1e-5)
