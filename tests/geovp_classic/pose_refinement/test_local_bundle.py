"""Poses and depths of corners that are adjusted together, against a slow twin in numpy."""

import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.odometry.bundle import bundle_adjust
from geovp_classic.odometry.lens import Lens
from geovp_classic.pose_refinement import local_bundle
from geovp_classic.pose_refinement.local_bundle import Corners, Equations
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(120.0, 120.0, 63.5, 55.0, 128, 112)


def straight(num: int = 6, step: float = 0.8) -> FloatArray:
    return se3.exp(np.arange(num)[:, None] * np.array([0, 0, step, 0, 0, 0]))


def visible_corners(poses: FloatArray, given: FloatArray, noise_px: float = 0.1) -> Corners:
    """Exact corners of random points, in the true poses [S, 4, 4] (source from reference), and the
    given ones.
    """
    rng = np.random.default_rng(3)
    pixels = rng.uniform([5, 5], [122, 106], (150, 2))
    points = pinhole.unproject(pixels, rng.uniform(5, 40, 150), CAMERA)
    there, _ = pinhole.project(se3.transform(poses, points), CAMERA)
    there += rng.normal(0, noise_px, there.shape)
    rays = pinhole.unproject(pixels, np.ones(150), CAMERA)
    return Corners(rays, there, np.ones(there.shape[:2], dtype=bool), CAMERA, given)


def errors(corners: Corners, inverse_depth: FloatArray, poses: FloatArray) -> FloatArray:
    """Reprojection errors [S, N, 2] in units of ROBUST_PX; 0 where nothing is seen, or behind the
    camera.
    """
    points = (
        corners.rays @ np.swapaxes(poses[:, :3, :3], -1, -2)
        + inverse_depth[:, None] * poses[:, None, :3, 3]
    )
    valid = (corners.visible & (points[..., 2] > local_bundle.NEAR))[..., None]
    there, _ = pinhole.project(np.where(valid, points, [0.0, 0.0, 1.0]), corners.camera)
    return np.where(valid, there - corners.pixels, 0.0) / local_bundle.ROBUST_PX


def slow_equations(corners: Corners, inverse_depth: FloatArray, poses: FloatArray) -> Equations:
    """By derivatives from differences; each error counts by Cauchy's weight."""
    tiny, off = 1e-6, errors(corners, inverse_depth, poses)
    turned = [
        errors(corners, inverse_depth, se3.exp(sign * tiny * axis) @ poses)
        for axis in np.eye(6)
        for sign in (1, -1)
    ]
    by_twist = np.stack(
        [
            (ahead - back) / (2 * tiny)
            for ahead, back in zip(turned[::2], turned[1::2], strict=True)
        ],
        -1,
    )
    by_depth = (
        errors(corners, inverse_depth + tiny, poses) - errors(corners, inverse_depth - tiny, poses)
    ) / (2 * tiny)
    weight = 1 / (1 + (off**2).sum(axis=-1))
    deviation, precision = corners.deviation(poses), corners.precision
    prior_weight = 1 / (1 + (deviation**2).sum() / local_bundle.PRIOR_SCALE)
    return Equations(
        np.einsum("sn,snki,snkj->sij", weight, by_twist, by_twist)
        + prior_weight * np.stack([np.diag(diagonal) for diagonal in precision**2]),
        np.einsum("sn,snki,snk->si", weight, by_twist, off) + prior_weight * precision * deviation,
        np.einsum("sn,snk,snk->n", weight, by_depth, by_depth),
        np.einsum("sn,snk,snk->n", weight, by_depth, off),
        np.einsum("sn,snki,snk->nsi", weight, by_twist, by_depth),
    )


@pytest.fixture
def hard() -> tuple[Corners, FloatArray, FloatArray]:
    """Corners with errors, some unseen, some behind the last camera; inverse depths and poses off
    the given ones.
    """
    poses = se3.inverse(straight()[:3]) @ straight()[5]
    corners = visible_corners(poses, poses, noise_px=1.0)
    corners.visible[:, ::5] = False
    poses = se3.exp(np.array([0.01, 0, 0.02, 0.001, -0.002, 0])) @ poses
    poses[2, 2, 3] = -15.0
    depth = corners.triangulate()
    assert (
        0.1
        < ((corners.rays @ poses[2, :3, :3].T + depth[:, None] * poses[2, :3, 3])[:, 2] < 0).mean()
        < 0.9
    )
    return corners, depth, poses


def test_equations_are_those_of_the_slow_twin(hard: tuple[Corners, FloatArray, FloatArray]) -> None:
    corners, depth, poses = hard
    equations, expected = (
        corners.equations(depth, poses, corners.deviation(poses)),
        slow_equations(*hard),
    )
    for name in Equations.__dataclass_fields__:
        size = np.abs(getattr(expected, name)).max()
        np.testing.assert_allclose(
            getattr(equations, name), getattr(expected, name), rtol=1e-4, atol=1e-6 * size
        )


def test_cost_is_that_of_the_slow_twin(hard: tuple[Corners, FloatArray, FloatArray]) -> None:
    corners, depth, poses = hard
    deviation = corners.deviation(poses)
    expected = np.log1p((errors(*hard) ** 2).sum(axis=-1)).sum()
    expected += local_bundle.PRIOR_SCALE * np.log1p((deviation**2).sum() / local_bundle.PRIOR_SCALE)
    assert corners.cost(depth, poses, deviation) == pytest.approx(expected, rel=1e-9)


def test_a_step_solves_the_whole_system() -> None:
    # 3 poses and 150 depths as one dense matrix of 168 x 168.
    truth = se3.inverse(straight()[:3]) @ straight()[5]
    corners = visible_corners(truth, truth, noise_px=1.0)
    equations = corners.equations(corners.triangulate(), truth, corners.deviation(truth))
    whole = np.zeros((168, 168))
    for s in range(3):
        whole[6 * s : 6 * s + 6, 6 * s : 6 * s + 6] = equations.h_twist[s]
    whole[18:, 18:] = np.diag(equations.h_depth)
    whole[18:, :18] = equations.mixed.reshape(150, 18)
    whole[:18, 18:] = whole[18:, :18].T
    whole[range(168), range(168)] *= 1.01
    change = -np.linalg.solve(whole, np.concatenate([equations.g_twist.ravel(), equations.g_depth]))
    twists, deeper = equations.solved(damping=0.01)
    np.testing.assert_allclose(twists.ravel(), change[:18], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(deeper, change[18:], rtol=1e-6, atol=1e-9)


def test_poses_that_fit_stay_nearly_where_they_are() -> None:
    truth = se3.inverse(straight()[:5]) @ straight()[5]
    adjusted = local_bundle.adjust(visible_corners(truth, truth))
    moved = se3.log(adjusted @ se3.inverse(truth))
    assert np.rad2deg(np.abs(moved[:, 3:])).max() < 0.02
    assert np.abs(moved[:, :3]).max() < 0.01


def test_the_unit_is_that_of_the_given_poses() -> None:
    # Poses half as long fit the same images: nothing says that they are wrong.
    truth = se3.inverse(straight()[:5]) @ straight()[5]
    half = truth.copy()
    half[:, :3, 3] /= 2
    moved = se3.log(local_bundle.adjust(visible_corners(truth, half)) @ se3.inverse(half))
    assert np.abs(moved[:, :3]).max() < 0.01


def test_corners_without_error_give_their_depth() -> None:
    poses = se3.inverse(straight()[:5]) @ straight()[5]
    corners = visible_corners(poses, poses, noise_px=0.0)
    assert np.abs(errors(corners, corners.triangulate(), poses)).max() < 1e-6


def test_without_a_prior_the_answer_is_that_of_colmap(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_bundle, "ROTATION_RAD", 1.0)
    monkeypatch.setattr(local_bundle, "SHIFT_SHARE", 1.0)
    monkeypatch.setattr(local_bundle, "NUM_ROUNDS", 30)
    truth = se3.inverse(straight()[:5]) @ straight()[5]
    given = (
        se3.exp(np.random.default_rng(0).normal(0, 1, (5, 6)) * ((5e-3,) * 3 + (5e-4,) * 3)) @ truth
    )
    corners = visible_corners(
        truth, given, noise_px=0.02
    )  # far below ROBUST_PX: both losses are squares
    points = corners.rays / np.maximum(corners.triangulate(), 1e-3)[:, None]
    pixels = np.concatenate([pinhole.project(corners.rays, CAMERA)[0][None], corners.pixels])
    poses = np.concatenate([np.eye(4)[None], given])
    for _ in range(4):  # it stops early
        poses, points = bundle_adjust(poses, points, pixels, Lens(CAMERA), num_fixed=1)
    ours, theirs = local_bundle.adjust(corners), poses[1:]
    unit = np.linalg.norm(theirs[0, :3, 3]) / np.linalg.norm(ours[0, :3, 3])
    np.testing.assert_allclose(ours[:, :3, :3], theirs[:, :3, :3], atol=2e-5)
    np.testing.assert_allclose(ours[:, :3, 3] * unit, theirs[:, :3, 3], atol=5e-4)  # of 0.8 to 4
