"""Registration adjusts poses to the images where these contradict them."""

import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.pose_refinement.registration import (
    ImageRegistration,
    ReferenceTracker,
    direction_correction,
)
from geovp_classic.types import BoolArray, ByteArray
from tests.geovp_classic.boxed_street import CAMERA, image, straight


def nothing(images: ByteArray) -> BoolArray:
    return np.zeros(images.shape[1:], bool)


def test_a_pose_that_is_off_by_a_degree_is_corrected() -> None:
    truth = straight()
    images = np.stack([image(pose)[..., 0] for pose in truth])
    given = truth.copy()
    given[2] = given[2] @ se3.exp(np.array([0, 0, 0, np.deg2rad(1.0), 0, 0]))  # 2 px up or down
    registered = ImageRegistration().register(images, CAMERA, given, 5, nothing(images))
    errors = se3.inverse(registered) @ truth
    assert np.rad2deg(se3.rotation_angle_rad(errors)).max() < 0.15
    np.testing.assert_array_equal(registered[5], given[5])


def test_common_errors_of_directions_turn_the_future() -> None:
    given = straight(5)[:4]
    given[:, :3, 3] -= straight(5)[4, :3, 3]
    turn = se3.exp(np.array([0, 0, 0, 0, np.deg2rad(2.0), 0]))
    adjusted = given.copy()
    adjusted[:, :3, 3] = given[:, :3, 3] @ turn[:3, :3].T
    correction = direction_correction(given, adjusted, persistence=0.8, min_fraction=0.2)
    assert np.rad2deg(np.arcsin(correction[0, 2])) == pytest.approx(0.8 * 2.0, abs=0.01)
    np.testing.assert_array_equal(direction_correction(given, given, 0.8, 0.2), np.eye(3))


def test_poses_stay_without_texture_or_motion() -> None:
    blank = np.full((6, 112, 128), 90, np.uint8)
    registered = ImageRegistration().register(blank, CAMERA, straight(), 5, nothing(blank))
    np.testing.assert_array_equal(registered, straight())
    stationary = np.tile(np.eye(4), (3, 1, 1))
    images = np.tile(image(np.eye(4))[..., 0], (3, 1, 1))
    registered = ImageRegistration().register(images, CAMERA, stationary, 2, nothing(images))
    np.testing.assert_array_equal(registered, stationary)


def test_a_wide_image_is_registered_by_its_middle() -> None:
    images = np.random.default_rng(4).integers(0, 256, (2, 64, 200)).astype(np.uint8)
    columns = ReferenceTracker().track(images, 0, nothing(images))[0][0, :, 0]
    assert columns.min() >= 49  # (200 - 1.6 * 64) / 2
    assert columns.max() < 151
    square = np.ascontiguousarray(images[:, :, :64])
    columns = ReferenceTracker().track(square, 0, nothing(square))[0][0, :, 0]
    assert columns.min() < 8
    assert columns.max() > 56
