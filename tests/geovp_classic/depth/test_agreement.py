"""How one frame's depth is confirmed by another's."""

import numpy as np

from geovp_classic.depth.sweep import agreement
from geovp_classic.geometry import se3
from geovp_classic.types import Intrinsics

CAMERA = Intrinsics(100.0, 100.0, 31.5, 31.5, 64, 64)
HALF = CAMERA.resized(32, 32)


def test_a_wall_is_confirmed_from_farther_away() -> None:
    back = se3.compose(np.eye(3), np.array([0, 0, 2.0]))  # the witness stood 2 behind
    wall = np.full((64, 64), 0.1, np.float32)
    right = agreement(wall, CAMERA, np.full((32, 32), 1 / 12, np.float32), HALF, back, 0.1)
    wrong = agreement(wall, CAMERA, np.full((32, 32), 1 / 24, np.float32), HALF, back, 0.1)
    np.testing.assert_allclose(right, 1.0, atol=1e-4)
    assert wrong.max() < 1e-4  # off by a half: exp(-12.5)


def test_half_way_at_the_tolerance() -> None:
    wall = np.full((64, 64), 0.1, np.float32)
    near = agreement(wall, CAMERA, np.full((32, 32), 0.09, np.float32), HALF, np.eye(4), 0.1)
    np.testing.assert_allclose(near[8:-8, 8:-8], np.exp(-0.5), rtol=1e-3)


def test_what_the_witness_does_not_see_is_not_confirmed() -> None:
    aside = se3.compose(np.eye(3), np.array([-3.0, 0, 0]))  # 30 px to the left
    seen = agreement(np.full((64, 64), 0.1, np.float32), CAMERA, np.full((32, 32), 0.1, np.float32), HALF, aside, 0.1)
    assert (seen[:, :28] == 0).all()
    np.testing.assert_allclose(seen[:, 34:], 1.0, atol=1e-4)


def test_the_sky_confirms_the_sky() -> None:
    witness = np.zeros((32, 32), np.float32)
    witness[16:] = 0.2
    own = np.zeros((64, 64), np.float32)
    own[32:] = 0.2
    assert agreement(own, CAMERA, witness, HALF, np.eye(4), 0.1)[:24].min() == 1.0
