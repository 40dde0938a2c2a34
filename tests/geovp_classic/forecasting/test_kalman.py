"""Kalman forecasters on motions with a known continuation."""

import numpy as np
import pytest

from geovp_classic.forecasting.interacting import Interacting
from geovp_classic.forecasting.kalman import AccelerationKalman, TurnRateKalman, fitted
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory

ALL = [TurnRateKalman(), AccelerationKalman(), Interacting()]
STEP_S = 0.1


def circle(speed_m_s: float, turn_rad_s: float, num_steps: int) -> FloatArray:
    """Return poses [T, 4, 4] of a camera ahead of a rear axle that drives a level circle."""
    twist = np.array([0, 0, speed_m_s, 0, turn_rad_s, 0]) * STEP_S
    start = se3.exp(np.array([2.0, 0, 5, 0, 0, 0]))
    lever_arm = np.array([0, 0, fitted("turn-rate").lever_arm_m])
    axle_from_cam = se3.compose(np.eye(3), lever_arm)
    return start @ se3.exp(np.outer(np.arange(num_steps), twist)) @ axle_from_cam


def past_of(poses: FloatArray) -> Trajectory:
    return Trajectory(poses, np.arange(len(poses)) * STEP_S, is_metric=True)


@pytest.mark.parametrize("forecaster", ALL)
def test_a_straight_drive_continues_straight(forecaster: Forecaster) -> None:
    whole = circle(8.0, 0.0, 30)
    ahead = forecaster.forecast(past_of(whole[:10]), np.arange(10, 30) * STEP_S)
    assert ahead.shape == (1, 20, 4, 4)
    np.testing.assert_allclose(ahead[0, :, :3, 3], whole[10:, :3, 3], atol=0.05)  # of 16 m
    assert ahead[0, -1, 2, 3] <= whole[-1, 2, 3] + 1e-3


def test_a_filter_estimates_speed_and_turn_rate() -> None:
    times_s = np.cumsum([0.1, 0.05, 0.2, 0.1, 0.1, 0.15, 0.1, 0.1])
    start = np.array([0, 0, 3.0, 8.0, 0.5])  # its yaw passes pi
    measured = np.stack([fitted("turn-rate").transition(start, t)[:3] for t in times_s])
    [(weight, vehicle)] = TurnRateKalman().filtered(measured, times_s)
    assert weight == 1
    assert vehicle.x[3] == pytest.approx(8.0, abs=0.05)
    assert vehicle.x[4] == pytest.approx(0.5, abs=0.02)
    np.testing.assert_allclose(vehicle.P, vehicle.P.T, atol=1e-12)
    assert np.linalg.eigvalsh(vehicle.P)[0] > 0


def measured_along(
    speed_m_s: FloatArray,  # [N - 1], in each step
    turn_rad_s: FloatArray,  # [N - 1]
) -> FloatArray:
    """Return (x, z, yaw) [N, 3] of a drive from the origin along z."""
    yaw = np.concatenate([[0.0], np.cumsum(turn_rad_s * STEP_S)])
    chord_yaw = (yaw[1:] + yaw[:-1]) / 2
    step = speed_m_s * STEP_S
    x = np.concatenate([[0.0], np.cumsum(step * np.sin(chord_yaw))])
    z = np.concatenate([[0.0], np.cumsum(step * np.cos(chord_yaw))])
    return np.stack([x, z, yaw], axis=1)


@pytest.mark.parametrize(
    ("turn_rad_s", "braking_m_s2", "expected"),
    [(0.0, 0.0, 0), (0.4, 0.0, 1), (0.0, 4.0, 2), (0.4, 4.0, 2)],
    ids=["straight", "turn", "braking", "braking in a turn"],
)
def test_the_model_that_fits_the_drive_is_the_likeliest(
    turn_rad_s: float, braking_m_s2: float, expected: int
) -> None:
    speeds = 12.0 - braking_m_s2 * STEP_S * np.arange(19)
    measured = measured_along(speeds, np.full(19, turn_rad_s))
    filters = Interacting().filtered(measured, np.arange(20) * STEP_S)
    probabilities = [weight for weight, _ in filters]  # of constant velocity, CTRV, CTRA
    assert sum(probabilities) == pytest.approx(1.0)
    assert np.argmax(probabilities) == expected


def test_the_interacting_models_are_mixed_by_their_probabilities() -> None:
    past = past_of(circle(8.0, 0.3, 10))
    times_s = np.arange(10, 20) * STEP_S
    forecast = Interacting(body_motion=None).distribution(past, times_s)
    mean = np.tensordot(forecast.weights, forecast.means, axes=1)
    futures = Interacting(body_motion=None).forecast(past, times_s)
    np.testing.assert_allclose(forecast.states_of(futures)[0], mean, atol=1e-9)
    assert forecast.means.shape == (3, 10, 3)
