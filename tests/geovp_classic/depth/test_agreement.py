"""How one frame's depth is confirmed by another's."""

import numpy as np

from geovp_classic.depth.confirmation import agreement
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(100.0, 100.0, 31.5, 31.5, 64, 64)
HALF = CAMERA.resized(32, 32)


def slow_agreement(inverse_depth: FloatArray, witness: FloatArray, witness_from_cam: FloatArray) -> FloatArray:
    """Point by point through space, at a tolerance of 0.1."""
    points = pinhole.rays(CAMERA) @ witness_from_cam[:3, :3].T + inverse_depth[..., None] * witness_from_cam[:3, 3]
    pixels, z = pinhole.project(points, HALF)
    confirmed = np.zeros(inverse_depth.shape)
    for row, column in np.argwhere(z > 0):
        u, v = pixels[row, column]
        if -0.5 <= u <= 31.5 and -0.5 <= v <= 31.5:
            u, v = np.clip((u, v), 0, 31)
            left, top = min(int(u), 30), min(int(v), 30)
            across, down = np.array([left + 1 - u, u - left]), np.array([top + 1 - v, v - top])
            found, there = (
                down @ witness[top : top + 2, left : left + 2] @ across,
                inverse_depth[row, column] / z[row, column],
            )
            off = abs(found - there) / max(found, there, 0.01 * np.quantile(witness, 0.99))
            confirmed[row, column] = np.exp(-0.5 * (off / 0.1) ** 2)
    return confirmed


def test_equals_the_slow_twin() -> None:
    rng = np.random.default_rng(0)
    own, witness = (
        rng.uniform(0.1, 0.14, (64, 64)).astype(np.float32),
        rng.uniform(0.1, 0.14, (32, 32)).astype(np.float32),
    )
    motion = se3.exp(np.array([0.5, -0.3, -1.0, 0.02, 0.1, -0.03]))
    expected = slow_agreement(own, witness, motion)
    assert 0.2 < (expected > 0.1).mean() < 0.9
    np.testing.assert_allclose(agreement(own, CAMERA, witness, HALF, motion, 0.1), expected, atol=1e-3)


def test_nothing_behind_the_witness_is_confirmed() -> None:
    ahead = se3.compose(np.eye(3), np.array([0, 0, -20.0]))  # the wall is 10 behind it
    wall = np.full((64, 64), 0.1, np.float32)
    assert not agreement(wall, CAMERA, np.full((32, 32), 0.1, np.float32), HALF, ahead, 0.1).any()


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
