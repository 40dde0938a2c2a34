"""The persistent turn on motions with a known continuation."""

import numpy as np
import pytest

from geovp_classic.forecasting.constant import ConstantTurn
from geovp_classic.forecasting.persistent_turn import PersistentTurn
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory

STEP_S = 0.1
TIMES_S = STEP_S * np.arange(10, 30)


def moved(
    twists_per_s: FloatArray,  # [N, 6]
) -> Trajectory:
    poses = [np.eye(4)]
    for step in se3.exp(STEP_S * twists_per_s):
        poses.append(poses[-1] @ step)
    return Trajectory(np.stack(poses), STEP_S * np.arange(len(poses)), is_metric=False)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_uniform_translation_continues_in_any_direction(axis: int) -> None:
    twist = np.zeros((29, 6))
    twist[:, axis] = 10.0  # a step of 1
    whole = moved(twist)
    ahead = PersistentTurn().forecast(whole[:10], TIMES_S)[0]
    np.testing.assert_allclose(ahead, whole.world_from_cam[10:], atol=0.02)


def test_a_turn_is_shrunk_by_its_variance() -> None:
    """Rates of .2 and .4 in turn, without forgetting: mean .3, unbiased variance .1^2 n / (n-1)."""
    rates = np.tile([0.2, 0.4], 5)
    twist = np.zeros((10, 6))
    twist[:, 4] = rates
    past = moved(twist)
    forecaster = PersistentTurn(half_life_s=1e9, variance_factor=2.0, num_steps=10)
    variance = 0.1**2 * 10 / 9
    expected = 0.3 * 0.3**2 / (0.3**2 + 2 * variance)
    np.testing.assert_allclose(forecaster.twist_per_s(past)[4], expected, rtol=1e-6)


def test_a_shaking_hand_returns_to_its_mean() -> None:
    """White noise of the rotation: its mean is a better forecast than its last value."""
    rng = np.random.default_rng(0)
    errors_rad = []
    for _ in range(20):
        twists = np.tile([0.0, 0.0, 10.0, 0.0, 0.0, 0.0], (29, 1))
        twists[:, 3:] = rng.normal(0, 0.3, (29, 3))
        whole = moved(twists)
        errors_rad.append(
            [
                se3.rotation_angle_rad(
                    se3.inverse(whole.world_from_cam[10:])
                    @ forecaster.forecast(whole[:10], TIMES_S)[0]
                ).mean()
                for forecaster in (PersistentTurn(), ConstantTurn(num_steps=1))
            ]
        )
    damped, constant = np.mean(errors_rad, axis=0)
    assert damped < 0.5 * constant


@pytest.mark.parametrize("num_poses", [1, 2, 10])
def test_a_stationary_camera_stays(num_poses: int) -> None:
    past = Trajectory(np.tile(np.eye(4), (num_poses, 1, 1)), STEP_S * np.arange(num_poses), False)
    ahead = PersistentTurn().forecast(past, past.times_s[-1] + np.array([0.1, 2.0]), num_samples=2)
    np.testing.assert_allclose(ahead, np.tile(np.eye(4), (2, 2, 1, 1)), atol=1e-9)


def test_the_world_frame_and_the_unit_do_not_matter() -> None:
    twists = np.random.default_rng(1).normal([3.0, 1.0, 5.0, 0, 0, 0], 0.3, (9, 6))
    past = moved(twists)
    other_from_world = se3.exp(np.array([5.0, -3.0, 10.0, 0.4, -1.0, 0.3]))
    elsewhere = Trajectory(other_from_world @ past.world_from_cam, past.times_s, False)
    expected = other_from_world @ PersistentTurn().forecast(past, TIMES_S)
    np.testing.assert_allclose(PersistentTurn().forecast(elsewhere, TIMES_S), expected, atol=1e-9)
    larger_poses = past.world_from_cam.copy()
    larger_poses[:, :3, 3] *= 7
    larger = PersistentTurn().forecast(Trajectory(larger_poses, past.times_s, False), TIMES_S)
    ahead = PersistentTurn().forecast(past, TIMES_S)
    np.testing.assert_allclose(larger[..., :3, 3], 7 * ahead[..., :3, 3], rtol=1e-4, atol=1e-4)
