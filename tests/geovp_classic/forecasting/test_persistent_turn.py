"""The persistent turn on motions with a known continuation."""

import numpy as np
import pytest

from geovp_classic.forecasting.persistent_turn import PersistentTurn
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory

STEP_S = 0.1


def moved(
    twists_per_s: FloatArray,  # [N, 6]
) -> Trajectory:
    poses = [np.eye(4)]
    for step in se3.exp(STEP_S * twists_per_s):
        poses.append(poses[-1] @ step)
    return Trajectory(np.stack(poses), STEP_S * np.arange(len(poses)), is_metric=False)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_uniform_translation_continues_in_any_direction(axis: int) -> None:
    whole = moved(np.tile(10 * np.eye(6)[axis], (29, 1)))  # a step of 1
    ahead = PersistentTurn().forecast(whole[:10], whole.times_s[10:])[0]
    np.testing.assert_allclose(ahead, whole.world_from_cam[10:], atol=0.02)


def test_a_turn_is_shrunk_by_its_variance() -> None:
    """Rates of .2 and .4 in turn, without forgetting: mean .3, unbiased variance .1^2 n / (n-1)."""
    past = moved(np.tile([0.2, 0.4], 5)[:, None] * np.eye(6)[4])
    forecaster = PersistentTurn(half_life_s=1e9, variance_factor=2.0, num_steps=10)
    expected, _ = forecaster.twists_per_s(past)
    np.testing.assert_allclose(expected[4], 0.027 / (0.09 + 0.2 / 9), rtol=1e-6)


def test_a_sway_swings_back() -> None:
    """A rate of 1 after steps without rotation: 1 at first, widest after .3 s, and none at the end."""
    forecaster = PersistentTurn(present_half_life_s=1e-3, variance_factor=1e9)
    past = moved(np.eye(6)[[0] * 8 + [4]])
    (ahead,) = forecaster.forecast(past, np.array([0.901, 1.2, 9]))
    turns = se3.log(se3.inverse(past.world_from_cam[-1]) @ ahead)[:, 4]
    np.testing.assert_allclose(turns, [1e-3, 0.3 / np.e, 0], atol=1e-5)
