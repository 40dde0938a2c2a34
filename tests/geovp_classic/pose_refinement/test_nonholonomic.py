"""Coming poses are held to the vehicle's course as far as recorded ones erred in the past, and no
farther.
"""

from __future__ import annotations

import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.pose_refinement import nonholonomic
from geovp_classic.pose_refinement.nonholonomic import MotionDirection
from geovp_classic.types import FloatArray

PAST, FUTURE = 10, 20


def drive(
    turn_rad: float = 0.0, lever_m: float = nonholonomic.LEVER_M, down: float = 0.02
) -> FloatArray:
    """Poses [P + F, 4, 4] of a camera on a car, a metre a frame; it looks a little above its way."""
    step = np.array([lever_m * turn_rad, down, 1.0, 0, turn_rad, 0])
    return se3.exp(np.arange(1 - PAST, FUTURE + 1)[:, None] * step)


def sinking(poses: FloatArray, share: float = 0.01) -> FloatArray:
    """The same as recorded by what loses height, a share of the way."""
    drifted = poses.copy()
    drifted[:, 1, 3] += (
        share * np.linalg.norm(poses[:, :3, 3], axis=1) * np.sign(np.arange(len(poses)) - PAST + 1)
    )
    return drifted


def error_m(poses: FloatArray, truth: FloatArray) -> FloatArray:
    return np.linalg.norm((poses - truth)[:, :3, 3], axis=1)


@pytest.mark.parametrize("turn_rad", [0.0, 0.02, -0.05])
def test_a_lost_height_is_given_back_for_the_most_part(turn_rad: float) -> None:
    truth = drive(turn_rad)
    given = sinking(truth)
    direction = nonholonomic.motion_direction(given[:PAST], truth[:PAST])
    assert direction is not None
    followed = direction.constrain(given[PAST:])
    assert error_m(given[PAST:], truth[PAST:])[-1] > 0.15
    assert error_m(followed, truth[PAST:])[-1] < 0.03
    np.testing.assert_array_equal(followed[:, :3, :3], given[PAST:, :3, :3])


def test_the_course_is_that_of_the_axle_whatever_the_turn() -> None:
    expected = np.array([0, 0.02, 1.0]) / np.hypot(0.02, 1.0)
    for turn_rad in (0.0, 0.05):
        poses = drive(turn_rad)[:PAST]
        direction = nonholonomic.motion_direction(sinking(poses), poses)
        assert direction is not None
        np.testing.assert_allclose(direction.direction, expected, atol=1e-3)
        assert direction.constraint_error_rad < 1e-3
        np.testing.assert_allclose(direction.given_error_rad, 0.01 / np.sqrt(2), rtol=0.05)


def test_poses_that_the_images_agree_with_stay() -> None:
    truth = drive()
    direction = nonholonomic.motion_direction(truth[:PAST], truth[:PAST])
    assert direction is not None
    sideways = se3.exp(np.arange(1, 5)[:, None] * np.array([1.0, 0, 0, 0, 0, 0]))
    np.testing.assert_array_equal(direction.constrain(sideways), sideways)


def test_a_way_that_is_meant_to_go_sideways_does() -> None:
    truth = drive()
    direction = nonholonomic.motion_direction(sinking(truth)[:PAST], truth[:PAST])
    assert direction is not None
    sideways = se3.exp(np.arange(1, 5)[:, None] * np.array([1.0, 0, 0, 0, 0, 0]))
    assert error_m(direction.constrain(sideways), sideways).max() < 0.05


def test_a_camera_that_keeps_no_course_is_left_alone() -> None:
    rng = np.random.default_rng(0)
    truth = drive()
    truth[: PAST - 1, :2, 3] += 0.5 * rng.standard_normal((PAST - 1, 2))
    given = sinking(truth)
    direction = nonholonomic.motion_direction(given[:PAST], truth[:PAST])
    assert direction is not None
    assert direction.constraint_error_rad > 5 * direction.given_error_rad
    assert error_m(direction.constrain(given[PAST:]), given[PAST:]).max() < 0.02


def test_a_lane_change_stays_one() -> None:
    truth = drive()
    away = np.sin(np.linspace(0, np.pi, FUTURE)) * 0.06
    yaw = np.concatenate([np.zeros(PAST), away])
    steps = np.zeros((PAST + FUTURE, 6))
    steps[:, 4] = np.diff(yaw, prepend=0)
    steps[:, 2], steps[:, 0] = 1.0, nonholonomic.LEVER_M * steps[:, 4]
    poses = [truth[0]]
    for step in se3.exp(steps[1:]):
        poses.append(poses[-1] @ step)
    changed = np.stack(poses)
    changed = se3.inverse(changed[PAST - 1]) @ changed
    direction = MotionDirection(
        np.array([0, 0, 1.0]), given_error_rad=0.01, constraint_error_rad=0.0
    )
    assert changed[-1, 0, 3] > 0.5
    assert error_m(direction.constrain(changed[PAST:]), changed[PAST:]).max() < 0.02


def test_standing_still_shows_no_course() -> None:
    still = np.tile(np.eye(4), (PAST, 1, 1))
    assert nonholonomic.motion_direction(still, still) is None


def test_a_single_pose_shows_no_course() -> None:
    alone = np.eye(4)[None]
    assert nonholonomic.motion_direction(alone, alone) is None


def test_stops_on_the_way_are_no_trouble() -> None:
    truth = drive()
    direction = nonholonomic.motion_direction(sinking(truth)[:PAST], truth[:PAST])
    assert direction is not None
    stopped = np.repeat(sinking(truth)[PAST : PAST + 2], 3, axis=0)
    followed = direction.constrain(stopped)
    assert np.isfinite(followed).all()
    np.testing.assert_array_equal(followed[3], followed[5])
    assert direction.constrain(np.zeros((0, 4, 4))).shape == (0, 4, 4)
