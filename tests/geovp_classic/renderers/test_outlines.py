from __future__ import annotations

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.renderers.given_depth import outlines
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(100.0, 100.0, 15.5, 15.5, 32, 32)


def aside(metres: float) -> FloatArray:
    return se3.compose(np.eye(3), np.array([metres, 0.0, 0.0]))


def two_walls() -> FloatArray:
    """Left of column 16 a wall at 10 m, right of it one at 20 m: 100 px * (1/10 - 1/20) = 5 px of
    parallax a metre.
    """
    return np.where(np.arange(32) < 16, 1 / 10, 1 / 20) * np.ones((32, 1))


def test_surfaces_part_by_their_parallax() -> None:
    pairs = outlines(two_walls(), CAMERA)
    assert not pairs.parted(aside(0.19), CAMERA).any()  # 0.95 px
    parted = pairs.parted(aside(-0.21), CAMERA)  # 1.05 px
    assert parted[:, 15:17].all()
    assert parted.sum() == 2 * 32


def test_a_view_with_half_the_focal_length_sees_them_part_half_as_far() -> None:
    wide = Intrinsics(50.0, 50.0, 7.5, 7.5, 16, 16)
    pairs = outlines(two_walls(), CAMERA)
    assert not pairs.parted(aside(0.39), wide).any()  # 0.975 px
    assert pairs.parted(aside(0.41), wide).sum() == 2 * 32


def test_turning_parts_nothing() -> None:
    turned = se3.exp(np.array([0.0, 0.0, 0.0, 0.05, 0.1, 0.02]))
    assert not outlines(two_walls(), CAMERA).parted(turned, CAMERA).any()


def test_planes_have_no_outlines_however_steep() -> None:
    columns, rows = np.arange(32), np.arange(32)[:, None]
    plane = 0.05 + 0.004 * columns + 0.002 * rows
    assert len(outlines(plane, CAMERA).pairs) == 0


def test_beside_unknown_depth_nothing_is_said() -> None:
    inverse_depth = two_walls()
    inverse_depth[:, 15:17] = np.nan
    assert not outlines(inverse_depth, CAMERA).parted(aside(1.0), CAMERA).any()


def test_the_sky_parts_from_what_stands_before_it() -> None:
    inverse_depth = two_walls()
    inverse_depth[:16] = 0.0  # 10 px and 5 px of parallax a metre against the walls below
    parted = outlines(inverse_depth, CAMERA).parted(aside(0.15), CAMERA)  # 1.5 px, 0.75 px
    assert parted[15:17, :16].all()
    assert not parted[15:17, 16:].any()
