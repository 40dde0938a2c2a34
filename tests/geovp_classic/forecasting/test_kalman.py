"""Kalman forecasters: circles go on as circles, standing stands, uncertainty grows, nothing breaks
at the seams.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geovp_classic.errors import UnknownComponent
from geovp_classic.forecasting.kalman import (
    AccelerationKalman,
    TurnRateKalman,
    TurnRateUnscented,
    fitted,
)
from geovp_classic.geometry import planar, se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory

ALL = [TurnRateKalman(), TurnRateUnscented(), AccelerationKalman()]
STEP_S = 0.1
LEVER_ARM_M = fitted("turn-rate").lever_arm


def circle(
    speed_m_s: float, turn_rad_s: float, num_steps: int, first_yaw_rad: float = 0.0
) -> FloatArray:
    """Camera poses [T, 4, 4] of a car whose rear axle drives a circle on the level; the camera sits
    ahead of it.
    """
    twist = np.array([0, 0, speed_m_s, 0, turn_rad_s, 0]) * STEP_S
    start = se3.exp(np.array([2.0, 0, 5, 0, first_yaw_rad, 0]))
    axle_from_cam = se3.compose(np.eye(3), np.array([0, 0, LEVER_ARM_M]))
    return np.stack([start @ se3.exp(twist * step) @ axle_from_cam for step in range(num_steps)])


def past_of(poses: FloatArray, is_metric: bool = True) -> Trajectory:
    return Trajectory(poses, np.arange(len(poses)) * STEP_S, is_metric)


@pytest.mark.parametrize("forecaster", ALL)
def test_a_straight_drive_goes_on_straight(forecaster: Forecaster) -> None:
    whole = circle(8.0, 0.0, 30)
    ahead = forecaster.forecast(past_of(whole[:10]), np.arange(10, 30) * STEP_S)
    assert ahead.shape == (1, 20, 4, 4)
    # 16 m ahead; the unscented mean is shorter, because it averages over headings that are not
    # sure.
    shorter = 0.05 if isinstance(forecaster, TurnRateUnscented) else 0.003
    np.testing.assert_allclose(ahead[0, :, :3, 3], whole[10:, :3, 3], atol=16 * shorter)
    assert ahead[0, -1, 2, 3] <= whole[-1, 2, 3] + 1e-3


@pytest.mark.parametrize("forecaster", ALL[:2])
@pytest.mark.parametrize(
    "first_yaw_rad", [0.0, np.pi - 0.05]
)  # the second one turns over the seam at pi
def test_a_circle_goes_on_as_a_circle(forecaster: Forecaster, first_yaw_rad: float) -> None:
    whole = circle(5.0, 0.5, 20, first_yaw_rad)
    ahead = forecaster.forecast(past_of(whole[:10]), np.arange(10, 20) * STEP_S)
    # 1 s on a circle of 10 m radius is an arc of 5 m and 0.5 rad.
    reference, level = whole[9], planar.level_vehicle_from_cam()
    wanted, found = (planar.reduce(poses, reference, level)[-1] for poses in (whole[10:], ahead[0]))
    np.testing.assert_allclose(found[:2], wanted[:2], atol=0.25)
    assert found[2] == pytest.approx(wanted[2], abs=0.05)


@pytest.mark.parametrize("forecaster", ALL)
def test_what_stands_still_stays(forecaster: Forecaster) -> None:
    still = np.tile(circle(0.0, 0.0, 1), (10, 1, 1))
    ahead = forecaster.forecast(past_of(still), np.arange(10, 30) * STEP_S)
    np.testing.assert_allclose(ahead[0], still[:1].repeat(20, 0), atol=0.05)


@pytest.mark.parametrize("forecaster", ALL)
def test_samples_spread_as_the_covariance_says_and_repeat(forecaster: TurnRateKalman) -> None:
    past, times_s = past_of(circle(8.0, 0.1, 10)), np.arange(10, 20) * STEP_S
    futures = forecaster.forecast(past, times_s, num_samples=400)
    np.testing.assert_array_equal(futures, forecaster.forecast(past, times_s, num_samples=400))
    said = forecaster.distribution(past, times_s)
    states = said.states_of(futures)[:, -1]
    deviation = np.sqrt(np.diagonal(said.covariances[0, -1]))
    np.testing.assert_allclose(states.mean(axis=0), said.means[0, -1], atol=0.3 * deviation.max())
    np.testing.assert_allclose(states.std(axis=0), deviation, rtol=0.3)
    volumes = np.linalg.det(said.covariances[0])
    assert (np.diff(volumes) > 0).all()  # the farther ahead, the less is known


@settings(max_examples=30)
@given(
    st.sampled_from(ALL),
    st.integers(1, 12),
    st.floats(0, 40),
    st.floats(-4, 4),
    st.lists(st.floats(0.01, 1.5), min_size=1, max_size=6),
    st.booleans(),
)
def test_futures_are_always_finite_and_rigid(
    forecaster: Forecaster,
    num_past: int,
    speed: float,
    turn: float,
    gaps_s: list[float],
    is_metric: bool,
) -> None:
    past = past_of(circle(speed, turn, num_past), is_metric)
    times_s = past.times_s[-1] + np.cumsum(gaps_s)
    futures = forecaster.forecast(past, times_s, num_samples=2)
    assert futures.shape == (2, len(times_s), 4, 4)
    for sample in futures:
        Trajectory(sample, times_s, is_metric)  # checks that it is finite and rigid


def test_unknown_constants_are_refused() -> None:
    with pytest.raises(UnknownComponent, match="turn-rate"):
        TurnRateKalman(constants="fast").forecast(past_of(circle(1, 0, 3)), np.array([0.5]))
