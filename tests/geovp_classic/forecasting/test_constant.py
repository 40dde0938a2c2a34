from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.errors import BadData
from geovp_classic.forecasting.constant import ConstantTurn, ConstantVelocity, Hold
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory

FORECASTERS = [
    Hold(),
    ConstantVelocity(),
    ConstantTurn(),
    ConstantVelocity(num_steps=3),
    ConstantTurn(num_steps=3),
]


def circle_pose(angle_rad: FloatArray, radius_m: float = 10.0) -> FloatArray:
    """A camera that drives a right-hand circle, looking along it; at angle 0 it is at the origin,
    looking along z.
    """
    angle_rad = np.asarray(angle_rad, dtype=np.float64)
    zero = np.zeros_like(angle_rad)
    rotation = se3.exp(np.stack([zero, zero, zero, zero, angle_rad, zero], axis=-1))[..., :3, :3]
    position = radius_m * np.stack([1 - np.cos(angle_rad), zero, np.sin(angle_rad)], axis=-1)
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
    ahead = ConstantTurn(num_steps).forecast(past, past.times_s[-1] + np.array([ahead_s]))
    np.testing.assert_allclose(
        ahead[0, 0], circle_pose(0.5 * (past.times_s[-1] + ahead_s)), atol=1e-9
    )


def test_constant_velocity_leaves_the_circle_on_the_last_chord() -> None:
    past = circle(np.array([0.0, 0.2, 0.3]))
    velocity = (past.world_from_cam[2, :3, 3] - past.world_from_cam[1, :3, 3]) / 0.1
    ahead = ConstantVelocity().forecast(past, np.array([0.5, 1.3]))[0]
    np.testing.assert_allclose(
        ahead[:, :3, 3], past.world_from_cam[2, :3, 3] + np.outer([0.2, 1.0], velocity)
    )
    np.testing.assert_array_equal(
        ahead[:, :3, :3], np.tile(past.world_from_cam[2, :3, :3], (2, 1, 1))
    )


def test_constant_velocity_averages_over_time_not_over_steps() -> None:
    poses = se3.compose(
        np.eye(3), np.array([[0, 0, 0.0], [0, 0, 3.0], [0, 0, 4.0]])
    )  # 3 m in 1 s, then 1 m in 1 s
    past = Trajectory(poses, np.array([0.0, 1.0, 2.0]), is_metric=True)
    assert ConstantVelocity(num_steps=1).forecast(past, np.array([3.0]))[
        0, 0, 2, 3
    ] == pytest.approx(5.0)
    assert ConstantVelocity(num_steps=2).forecast(past, np.array([3.0]))[
        0, 0, 2, 3
    ] == pytest.approx(6.0)
    assert ConstantTurn(num_steps=2).forecast(past, np.array([3.0]))[0, 0, 2, 3] == pytest.approx(
        6.0
    )
    assert ConstantTurn(num_steps=99).forecast(past, np.array([4.0]))[0, 0, 2, 3] == pytest.approx(
        8.0
    )


def test_hold_holds() -> None:
    past = circle(np.array([0.0, 0.1]))
    ahead = Hold().forecast(past, np.array([0.2, 5.0]), num_samples=3)
    np.testing.assert_array_equal(ahead, np.tile(past.world_from_cam[-1], (3, 2, 1, 1)))


@pytest.mark.parametrize("forecaster", FORECASTERS, ids=repr)
class TestEveryForecaster:
    def test_is_one(self, forecaster: Forecaster) -> None:
        assert isinstance(forecaster, Forecaster)

    def test_holds_after_a_single_pose(self, forecaster: Forecaster) -> None:
        past = circle(np.array([0.7]))
        np.testing.assert_allclose(
            forecaster.forecast(past, np.array([0.8]))[0, 0], past.world_from_cam[0], atol=1e-12
        )

    def test_holds_when_it_stood_still(self, forecaster: Forecaster) -> None:
        past = Trajectory(
            np.tile(circle_pose(np.array(0.3)), (5, 1, 1)), np.arange(5.0), is_metric=False
        )
        ahead = forecaster.forecast(past, np.array([5.0, 9.0]))
        np.testing.assert_allclose(ahead[0], np.tile(past.world_from_cam[0], (2, 1, 1)), atol=1e-9)

    def test_gives_as_many_equal_samples_as_asked_for(self, forecaster: Forecaster) -> None:
        ahead = forecaster.forecast(circle(np.arange(4.0)), np.array([4.0, 5.0]), num_samples=7)
        assert ahead.shape == (7, 2, 4, 4)
        assert (ahead == ahead[:1]).all()

    def test_does_not_depend_on_the_world_frame(self, forecaster: Forecaster) -> None:
        other_from_world = se3.exp(np.array([5.0, -3.0, 100.0, 0.4, -1.0, 0.3]))
        past, times_s = circle(np.arange(4.0)), np.array([4.5])
        moved = Trajectory(other_from_world @ past.world_from_cam, past.times_s, is_metric=True)
        np.testing.assert_allclose(
            forecaster.forecast(moved, times_s),
            other_from_world @ forecaster.forecast(past, times_s),
            atol=1e-9,
        )

    def test_no_past_at_all_is_an_error(self, forecaster: Forecaster) -> None:
        with pytest.raises(BadData, match="no past pose"):
            forecaster.forecast(circle(np.arange(3.0))[:0], np.array([1.0]))


@pytest.mark.parametrize("kind", [ConstantVelocity, ConstantTurn])
def test_averaging_over_no_step_is_refused(kind: type) -> None:
    with pytest.raises(BadData, match="num_steps is 0"):
        kind(num_steps=0)
