"""Poses are adjusted to the images where these contradict them, and left alone where they don't."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.pose_refinement import registration
from geovp_classic.types import FloatArray, Intrinsics

Image = Callable[..., FloatArray]
CAMERA = Intrinsics(120.0, 120.0, 63.5, 55.0, 128, 112)


def straight(num: int = 6, step: float = 0.8) -> FloatArray:
    return se3.exp(np.arange(num)[:, None] * np.array([0, 0, step, 0, 0, 0]))


def test_a_pose_that_is_off_by_a_degree_is_found_again(image: Image) -> None:
    truth = straight()
    images = np.stack([image(pose)[..., 0] for pose in truth]).astype(np.float32)
    given = truth.copy()
    given[2] = given[2] @ se3.exp(np.array([0, 0, 0, np.deg2rad(1.0), 0, 0]))  # 2 px up or down
    found = registration.registered(images, CAMERA, given, reference=5)
    off = se3.inverse(found.world_from_cam) @ truth
    assert np.rad2deg(se3.rotation_angle_rad(off)).max() < 0.15
    np.testing.assert_array_equal(found.world_from_cam[5], given[5])


def test_directions_that_all_err_alike_give_the_steering() -> None:
    given = straight(5)[:4]
    given[:, :3, 3] -= straight(5)[4, :3, 3]
    turn = se3.exp(np.array([0, 0, 0, 0, np.deg2rad(2.0), 0]))
    better = given.copy()
    better[:, :3, 3] = given[:, :3, 3] @ turn[:3, :3].T
    found = registration.direction_correction(given, better)
    angle = np.rad2deg(se3.rotation_angle_rad(se3.compose(found, np.zeros(3))))
    assert angle == pytest.approx(2.0 * registration.PERSISTENCE, abs=0.01)
    np.testing.assert_allclose(found[0, 2], np.sin(np.deg2rad(angle)), atol=1e-6)
    np.testing.assert_array_equal(registration.direction_correction(given, given), np.eye(3))


def test_nothing_to_see_or_no_motion_leaves_the_poses(image: Image) -> None:
    blank = np.full((6, 112, 128), 90, np.float32)
    found = registration.registered(blank, CAMERA, straight(), reference=5)
    np.testing.assert_array_equal(found.world_from_cam, straight())
    still = np.tile(np.eye(4), (3, 1, 1))
    images = np.tile(image(np.eye(4))[..., 0].astype(np.float32), (3, 1, 1))
    found = registration.registered(images, CAMERA, still, reference=2)
    np.testing.assert_array_equal(found.world_from_cam, still)
    np.testing.assert_array_equal(found.direction_correction, np.eye(3))


def test_tracks_end_where_they_should(image: Image) -> None:
    poses = straight(3)
    images = np.stack([image(pose)[..., 0] for pose in poses]).astype(np.float32)
    pixels, visible = registration.track(images, reference=1)
    assert visible[1].all()
    assert visible[0].mean() > 0.5
    assert visible[2].mean() > 0.5
    # Driving on, everything moves away from the epipole at (63.5, 55).
    before, after = (pixels[step] - [63.5, 55] for step in (1, 2))
    kept = visible[2]
    assert (np.linalg.norm(after, axis=-1) > np.linalg.norm(before, axis=-1) - 0.3)[
        kept
    ].mean() > 0.95


@pytest.mark.parametrize(("rows", "side"), [(64, 15), (256, 15), (370, 21), (512, 31)])
def test_windows_of_tracks_grow_with_tall_images(
    rows: int, side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    sides: list[tuple[int, int]] = []
    follow = cv2.calcOpticalFlowPyrLK

    def noted(*given: object, winSize: tuple[int, int], **named: object) -> object:  # noqa: N803
        sides.append(winSize)
        return follow(*given, winSize=winSize, **named)  # type: ignore[call-overload]

    monkeypatch.setattr(cv2, "calcOpticalFlowPyrLK", noted)
    registration.track(
        np.random.default_rng(5).uniform(0, 255, (2, rows, 80)).astype(np.float32), reference=0
    )
    assert set(sides) == {(side, side)}


def test_a_wide_image_is_registered_by_its_middle() -> None:
    images = np.random.default_rng(4).uniform(0, 255, (2, 64, 200)).astype(np.float32)
    columns = registration.track(images, reference=0)[0][0, :, 0]
    assert columns.min() >= 49  # (200 - 1.6 * 64) / 2
    assert columns.max() < 151
    square = registration.track(images[:, :, :64], reference=0)[0][0, :, 0]
    assert square.min() < 8
    assert square.max() > 56
