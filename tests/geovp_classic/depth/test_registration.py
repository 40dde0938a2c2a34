"""Poses are adjusted to the pictures where these contradict them, and left alone where they don't."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from geovp_classic.depth import registration
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import FloatArray, Intrinsics

Picture = Callable[..., FloatArray]
CAMERA = Intrinsics(120.0, 120.0, 63.5, 55.0, 128, 112)


def straight(num: int = 6, step: float = 0.8) -> FloatArray:
    return se3.exp(np.arange(num)[:, None] * np.array([0, 0, step, 0, 0, 0]))


def seen_corners(poses: FloatArray, given: FloatArray, noise_px: float = 0.1) -> registration.Corners:
    """Exact corners of random points, in the true poses [S, 4, 4] (source from reference), and the given ones."""
    rng = np.random.default_rng(3)
    pixels = rng.uniform([5, 5], [122, 106], (150, 2))
    points = pinhole.unproject(pixels, rng.uniform(5, 40, 150), CAMERA)
    there, _ = pinhole.project(se3.transform(poses, points), CAMERA)
    there += rng.normal(0, noise_px, there.shape)
    rays = pinhole.unproject(pixels, np.ones(150), CAMERA)
    return registration.Corners(rays, there, np.ones(there.shape[:2], dtype=bool), CAMERA, given)


def test_a_pose_that_is_off_by_a_degree_is_found_again(picture: Picture) -> None:
    truth = straight()
    pictures = np.stack([picture(pose)[..., 0] for pose in truth]).astype(np.float32)
    given = truth.copy()
    given[2] = given[2] @ se3.exp(np.array([0, 0, 0, np.deg2rad(1.0), 0, 0]))  # 2 px up or down
    found = registration.registered(pictures, CAMERA, given, reference=5)
    off = se3.inverse(found.world_from_cam) @ truth
    assert np.rad2deg(se3.rotation_angle_rad(off)).max() < 0.15
    np.testing.assert_array_equal(found.world_from_cam[5], given[5])


def test_poses_that_fit_stay_nearly_where_they_are() -> None:
    truth = se3.inverse(straight()[:5]) @ straight()[5]
    adjusted = registration.adjust(seen_corners(truth, truth))
    moved = se3.log(adjusted @ se3.inverse(truth))
    assert np.rad2deg(np.abs(moved[:, 3:])).max() < 0.02
    assert np.abs(moved[:, :3]).max() < 0.01


def test_the_unit_is_that_of_the_given_poses() -> None:
    # Poses half as long fit the same pictures: nothing says that they are wrong.
    truth = se3.inverse(straight()[:5]) @ straight()[5]
    half = truth.copy()
    half[:, :3, 3] /= 2
    moved = se3.log(registration.adjust(seen_corners(truth, half)) @ se3.inverse(half))
    assert np.abs(moved[:, :3]).max() < 0.01


def test_derivatives_are_those_of_the_errors() -> None:
    poses = se3.inverse(straight()[:2]) @ straight()[5]
    corners = seen_corners(poses, poses, noise_px=1.0)
    depth = registration._triangulated(corners)
    off, points = corners.errors(depth, poses)
    by_twist, by_depth = registration._derivatives(corners, points, depth, poses)
    tiny = 1e-6
    for axis in range(6):
        moved, _ = corners.errors(depth, se3.exp(tiny * np.eye(6)[axis]) @ poses)
        np.testing.assert_allclose((moved - off) / tiny, by_twist[..., axis], rtol=1e-3, atol=1e-3)
    deeper, _ = corners.errors(depth + tiny, poses)
    np.testing.assert_allclose((deeper - off) / tiny, by_depth, rtol=1e-3, atol=0.2)


def test_corners_without_error_give_their_depth() -> None:
    poses = se3.inverse(straight()[:5]) @ straight()[5]
    corners = seen_corners(poses, poses, noise_px=0.0)
    off, _ = corners.errors(registration._triangulated(corners), poses)
    assert np.abs(off).max() < 1e-6


def test_directions_that_all_err_alike_give_the_steering() -> None:
    given = straight(5)[:4]
    given[:, :3, 3] -= straight(5)[4, :3, 3]
    turn = se3.exp(np.array([0, 0, 0, 0, np.deg2rad(2.0), 0]))
    better = given.copy()
    better[:, :3, 3] = given[:, :3, 3] @ turn[:3, :3].T
    found = registration.steering(given, better)
    angle = np.rad2deg(se3.rotation_angle_rad(se3.compose(found, np.zeros(3))))
    assert angle == pytest.approx(2.0 * registration.PERSISTENCE, abs=0.01)
    np.testing.assert_allclose(found[0, 2], np.sin(np.deg2rad(angle)), atol=1e-6)
    np.testing.assert_array_equal(registration.steering(given, given), np.eye(3))


def test_nothing_to_see_or_no_motion_leaves_the_poses(picture: Picture) -> None:
    blank = np.full((6, 112, 128), 90, np.float32)
    found = registration.registered(blank, CAMERA, straight(), reference=5)
    np.testing.assert_array_equal(found.world_from_cam, straight())
    still = np.tile(np.eye(4), (3, 1, 1))
    pictures = np.tile(picture(np.eye(4))[..., 0].astype(np.float32), (3, 1, 1))
    found = registration.registered(pictures, CAMERA, still, reference=2)
    np.testing.assert_array_equal(found.world_from_cam, still)
    np.testing.assert_array_equal(found.steering, np.eye(3))


def test_tracks_end_where_they_should(picture: Picture) -> None:
    poses = straight(3)
    pictures = np.stack([picture(pose)[..., 0] for pose in poses]).astype(np.float32)
    tracks = registration.track(pictures, reference=1)
    assert tracks.seen[1].all()
    assert tracks.seen[0].mean() > 0.5
    assert tracks.seen[2].mean() > 0.5
    # Driving on, everything moves away from the epipole at (63.5, 55).
    before, after = (tracks.pixels[step] - [63.5, 55] for step in (1, 2))
    kept = tracks.seen[2]
    assert (np.linalg.norm(after, axis=-1) > np.linalg.norm(before, axis=-1) - 0.3)[kept].mean() > 0.95


@pytest.mark.parametrize(("rows", "side"), [(64, 15), (256, 15), (370, 21), (512, 31)])
def test_windows_of_tracks_grow_with_tall_pictures(rows: int, side: int, monkeypatch: pytest.MonkeyPatch) -> None:
    sides: list[tuple[int, int]] = []
    follow = cv2.calcOpticalFlowPyrLK

    def noted(*given: object, winSize: tuple[int, int]) -> object:  # noqa: N803
        sides.append(winSize)
        return follow(*given, winSize=winSize)  # type: ignore[call-overload]

    monkeypatch.setattr(cv2, "calcOpticalFlowPyrLK", noted)
    registration.track(np.random.default_rng(5).uniform(0, 255, (2, rows, 80)).astype(np.float32), reference=0)
    assert set(sides) == {(side, side)}


def test_a_wide_picture_is_registered_by_its_middle() -> None:
    pictures = np.random.default_rng(4).uniform(0, 255, (2, 64, 200)).astype(np.float32)
    columns = registration.track(pictures, reference=0).pixels[0, :, 0]
    assert columns.min() >= 49  # (200 - 1.6 * 64) / 2
    assert columns.max() < 151
    square = registration.track(pictures[:, :, :64], reference=0).pixels[0, :, 0]
    assert square.min() < 8
    assert square.max() > 56
