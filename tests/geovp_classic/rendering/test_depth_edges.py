"""Depth edges separate by the parallax of their two surfaces."""

import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.rendering.depth_edges import separated_edges
from geovp_classic.rendering.patches import PatchModel
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

CAMERA = Intrinsics(100.0, 100.0, 15.5, 15.5, 32, 32)
HALF_CAMERA = Intrinsics(50.0, 50.0, 7.5, 7.5, 16, 16)


def two_walls() -> FloatArray:
    """Return walls at 10 and 20 m: 100 px * (1/10 - 1/20) = 5 px of parallax per metre."""
    return np.where(np.arange(32) < 16, 1 / 10, 1 / 20) * np.ones((32, 1))


def separated(
    inverse_depth: FloatArray, twist: list[float], camera: Intrinsics = CAMERA
) -> BoolArray:
    epipolar = Epipolar.of(CAMERA, se3.exp(np.array(twist, float)), camera)
    return separated_edges(inverse_depth, epipolar, 1.0, PatchModel())


@pytest.mark.parametrize(
    ("shift_m", "camera", "is_separated"),
    [
        (0.19, CAMERA, False),  # 0.95 px
        (-0.21, CAMERA, True),  # 1.05 px
        (0.39, HALF_CAMERA, False),  # 0.975 px
        (0.41, HALF_CAMERA, True),
    ],
)
def test_walls_separate_by_their_parallax(
    shift_m: float, camera: Intrinsics, is_separated: bool
) -> None:
    expected = np.zeros((32, 32), bool)
    expected[:, 15:17] = is_separated
    np.testing.assert_array_equal(
        separated(two_walls(), [shift_m, 0, 0, 0, 0, 0], camera), expected
    )


def test_rotations_separate_nothing() -> None:
    assert not separated(two_walls(), [0, 0, 0, 0.05, 0.1, 0.02]).any()


def test_planes_have_no_edges_however_steep() -> None:
    plane = 0.05 + 0.004 * np.arange(32) + 0.002 * np.arange(32)[:, None]
    assert not separated(plane, [5, 0, 2, 0, 0, 0]).any()


def test_unknown_depth_has_no_edges() -> None:
    inverse_depth = two_walls()
    inverse_depth[:, 15:17] = np.nan
    assert not separated(inverse_depth, [1, 0, 0, 0, 0, 0]).any()


def test_the_sky_separates_from_the_walls_below() -> None:
    inverse_depth = two_walls()
    inverse_depth[:16] = 0.0
    is_separated = separated(inverse_depth, [0.15, 0, 0, 0, 0, 0])  # 1.5 px and 0.75 px
    assert is_separated[15:17, :16].all()
    assert not is_separated[15:17, 16:].any()
