"""The persistent turn on motions with a known continuation."""

import numpy as np
import pytest

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
