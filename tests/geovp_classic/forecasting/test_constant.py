"""Forecasters that repeat the last motion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.forecasting.constant import ConstantTurn, ConstantVelocity
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory


def circle_pose(angle_rad: FloatArray) -> FloatArray:
    """Return a camera on a right-hand circle of 10 m; at angle 0 it is at the origin and looks along z."""
    zero = np.zeros_like(angle_rad)
    rotation = se3.exp(np.stack([zero, zero, zero, zero, angle_rad, zero], axis=-1))[..., :3, :3]
    position = 10.0 * np.stack([1 - np.cos(angle_rad), zero, np.sin(angle_rad)], axis=-1)
    return se3.compose(rotation, position)


def circle(times_s: FloatArray) -> Trajectory:
    """5 m/s on a radius of 10 m: 0.5 rad/s."""
    return Trajectory(circle_pose(0.5 * times_s), times_s, is_metric=True)


@given(
    st.lists(st.floats(0.02, 0.5), min_size=2, max_size=8), st.floats(0.01, 3.0), st.integers(1, 9)
)
def test_a_circle_stays_a_circle_at_irregular_times(
    steps_s: list[float], ahead_s: float, num_steps: int
) -> None:
    past = circle(np.cumsum(steps_s))
    times_s = past.times_s[-1] + np.array([ahead_s])
    ahead = ConstantTurn(num_steps).forecast(past, times_s)
    np.testing.assert_allclose(ahead[0], circle_pose(0.5 * times_s), atol=1e-9)


def test_constant_velocity_continues_the_last_chord_of_a_circle() -> None:
    past = circle(np.array([0.0, 0.2, 0.3]))
    last = past.world_from_cam[2]
    velocity = (last - past.world_from_cam[1])[:3, 3] / 0.1
    ahead = ConstantVelocity().forecast(past, np.array([0.5, 1.3]))[0]
    np.testing.assert_allclose(ahead[:, :3, 3], last[:3, 3] + np.outer([0.2, 1.0], velocity))
    np.testing.assert_array_equal(ahead[:, :3, :3], np.tile(last[:3, :3], (2, 1, 1)))


@pytest.mark.parametrize(
    ("forecaster", "expected_m"),
    [
        (ConstantVelocity(num_steps=1), 5.0),
        (ConstantVelocity(num_steps=2), 6.0),
        (ConstantTurn(num_steps=2), 6.0),
        (ConstantTurn(num_steps=99), 6.0),
    ],
)
def test_the_motion_is_averaged_over_time(forecaster: Forecaster, expected_m: float) -> None:
    positions = np.array([[0, 0, 0.0], [0, 0, 3.0], [0, 0, 4.0]])  # 3 m in 1 s, then 1 m in 1 s
    past = Trajectory(se3.compose(np.eye(3), positions), np.arange(3.0), is_metric=True)
    ahead = forecaster.forecast(past, np.array([3.0]))
    assert ahead[0, 0, 2, 3] == pytest.approx(expected_m)
