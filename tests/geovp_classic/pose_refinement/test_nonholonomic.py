"""Future poses are drawn to the direction of motion as far as recorded ones erred in the past."""

import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.pose_refinement.nonholonomic import MotionDirection, NonholonomicConstraint
from geovp_classic.types import FloatArray

PAST, FUTURE = 10, 20
CONSTRAINT = NonholonomicConstraint()


def drive(
    turn_rad: float = 0.0, lever_m: float = CONSTRAINT.lever_m, down: float = 0.02
) -> FloatArray:
    """Return poses [P + F, 4, 4] of a camera on a car, a metre per frame, that looks slightly up."""
    step = np.array([lever_m * turn_rad, down, 1.0, 0, turn_rad, 0])
    return se3.exp(np.arange(1 - PAST, FUTURE + 1)[:, None] * step)


def sinking(poses: FloatArray, fraction: float = 0.01) -> FloatArray:
    """Return the poses as recorded by a device that loses height, a fraction of the path."""
    drifted = poses.copy()
    drifted[:, 1, 3] += (
        fraction
        * np.linalg.norm(poses[:, :3, 3], axis=1)
        * np.sign(np.arange(len(poses)) - PAST + 1)
    )
    return drifted


def error_m(poses: FloatArray, truth: FloatArray) -> FloatArray:
    return np.linalg.norm((poses - truth)[:, :3, 3], axis=1)


@pytest.mark.parametrize("turn_rad", [0.0, 0.02, -0.05])
def test_a_sinking_recording_is_raised(turn_rad: float) -> None:
    truth = drive(turn_rad)
    given = sinking(truth)
    direction = CONSTRAINT.motion_direction(given[:PAST], truth[:PAST])
    assert direction is not None
    followed = CONSTRAINT.constrain(given[PAST:], direction)
    assert error_m(given[PAST:], truth[PAST:])[-1] > 0.15
    assert error_m(followed, truth[PAST:])[-1] < 0.03
    np.testing.assert_array_equal(followed[:, :3, :3], given[PAST:, :3, :3])


def test_the_direction_is_that_of_the_axle_in_turns() -> None:
    expected = np.array([0, 0.02, 1.0]) / np.hypot(0.02, 1.0)
    for turn_rad in (0.0, 0.05):
        poses = drive(turn_rad)[:PAST]
        direction = CONSTRAINT.motion_direction(sinking(poses), poses)
        assert direction is not None
        np.testing.assert_allclose(direction.direction, expected, atol=1e-3)
        assert direction.constraint_error_rad < 1e-3
        np.testing.assert_allclose(direction.given_error_rad, 0.01 / np.sqrt(2), rtol=0.05)


def test_poses_that_agree_with_the_images_stay() -> None:
    truth = drive()
    direction = CONSTRAINT.motion_direction(truth[:PAST], truth[:PAST])
    assert direction is not None
    sideways = se3.exp(np.arange(1, 5)[:, None] * np.array([1.0, 0, 0, 0, 0, 0]))
    np.testing.assert_array_equal(CONSTRAINT.constrain(sideways, direction), sideways)


def test_intended_sideways_motion_stays() -> None:
    truth = drive()
    direction = CONSTRAINT.motion_direction(sinking(truth)[:PAST], truth[:PAST])
    assert direction is not None
    sideways = se3.exp(np.arange(1, 5)[:, None] * np.array([1.0, 0, 0, 0, 0, 0]))
    assert error_m(CONSTRAINT.constrain(sideways, direction), sideways).max() < 0.05


def test_a_camera_without_a_direction_is_left_alone() -> None:
    rng = np.random.default_rng(0)
    truth = drive()
    truth[: PAST - 1, :2, 3] += 0.5 * rng.standard_normal((PAST - 1, 2))
    given = sinking(truth)
    direction = CONSTRAINT.motion_direction(given[:PAST], truth[:PAST])
    assert direction is not None
    assert direction.constraint_error_rad > 5 * direction.given_error_rad
    assert error_m(CONSTRAINT.constrain(given[PAST:], direction), given[PAST:]).max() < 0.02


def test_a_lane_change_stays() -> None:
    truth = drive()
    away = np.sin(np.linspace(0, np.pi, FUTURE)) * 0.06
    yaw = np.concatenate([np.zeros(PAST), away])
    steps = np.zeros((PAST + FUTURE, 6))
    steps[:, 4] = np.diff(yaw, prepend=0)
    steps[:, 2], steps[:, 0] = 1.0, CONSTRAINT.lever_m * steps[:, 4]
    poses = [truth[0]]
    for step in se3.exp(steps[1:]):
        poses.append(poses[-1] @ step)
    changed = np.stack(poses)
    changed = se3.inverse(changed[PAST - 1]) @ changed
    direction = MotionDirection(
        np.array([0, 0, 1.0]), given_error_rad=0.01, constraint_error_rad=0.0
    )
    assert changed[-1, 0, 3] > 0.5
    assert error_m(CONSTRAINT.constrain(changed[PAST:], direction), changed[PAST:]).max() < 0.02


def test_a_stationary_camera_has_no_direction() -> None:
    still = np.tile(np.eye(4), (PAST, 1, 1))
    assert CONSTRAINT.motion_direction(still, still) is None


def test_a_single_pose_has_no_direction() -> None:
    alone = np.eye(4)[None]
    assert CONSTRAINT.motion_direction(alone, alone) is None


def test_stops_on_the_way_stay_finite() -> None:
    truth = drive()
    direction = CONSTRAINT.motion_direction(sinking(truth)[:PAST], truth[:PAST])
    assert direction is not None
    stopped = np.repeat(sinking(truth)[PAST : PAST + 2], 3, axis=0)
    followed = CONSTRAINT.constrain(stopped, direction)
    assert np.isfinite(followed).all()
    np.testing.assert_array_equal(followed[3], followed[5])
    assert CONSTRAINT.constrain(np.zeros((0, 4, 4)), direction).shape == (0, 4, 4)
