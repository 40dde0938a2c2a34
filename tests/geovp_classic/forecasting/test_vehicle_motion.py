"""The plane parts of the forecasters: the motion model, what a past says, and the mixture over the
plane.
"""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.errors import BadData
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.kalman import (
    TurnRateKalman,
    TurnRateUnscented,
    extended_prediction,
    fitted,
    joseph_update,
)
from geovp_classic.forecasting.motion_models import VehicleModel
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray, Trajectory

MODEL = VehicleModel(0.0, 0.0, 0.0, 0.02, 0.5, 0.1, 0.3)


def drive(twist_per_s: list[float], times_s: FloatArray, is_metric: bool = True) -> Trajectory:
    return Trajectory(se3.exp(times_s[:, None] * np.array(twist_per_s)), times_s, is_metric)


def test_a_quarter_circle_in_one_step() -> None:
    # 10 m/s, pi/2 rad/s: radius 20/pi; a quarter circle ends one radius ahead and one to the right.
    state = np.array([0, 0, 0, 10.0, np.pi / 2])
    later = MODEL.transition(state, 1.0)
    np.testing.assert_allclose(
        later, [20 / np.pi, 20 / np.pi, np.pi / 2, 10, np.pi / 2], atol=1e-12
    )


def test_without_a_turn_the_path_is_straight_and_smooth_in_the_turn_rate() -> None:
    ends = [MODEL.transition(np.array([0, 0, 0, 10.0, turn]), 0.5)[:2] for turn in (0.0, 1e-9)]
    np.testing.assert_allclose(ends[0], [0, 5])
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-7)


def test_a_camera_ahead_of_the_axle_swings_outwards() -> None:
    # Turning on the spot by 90 degrees takes a camera 2 m ahead of the axle from (0, 2) to (2, 0)
    # about the axle.
    swung = VehicleModel(0, 0, 2.0, 0, 0, 0, 0).transition(np.array([0, 2.0, 0, 0, np.pi / 2]), 1.0)
    np.testing.assert_allclose(swung[:2], [2, 0], atol=1e-12)


def test_braking_ends_at_rest() -> None:
    later = MODEL.transition(np.array([0, 0, 0, 2.0, 0, -4.0]), 1.0)
    assert later[3] == 0
    assert later[5] == 0
    assert later[1] == pytest.approx(1.0)  # half of 2 m/s for a second


def test_damping_takes_the_turn_rate_down_by_e() -> None:
    damped = VehicleModel(0.5, 0.0, 0.0, 0, 0, 0, 0).transition(np.array([0, 0, 0, 5.0, 1.0]), 2.0)
    assert damped[4] == pytest.approx(np.exp(-1))
    assert damped[2] == pytest.approx((1 - np.exp(-1)) / 0.5)


@given(st.floats(-3, 3), st.floats(0.5, 30), st.floats(0.01, 0.5), st.floats(0.01, 0.5))
def test_two_short_steps_add_the_noise_of_one_long_one(
    yaw: float, speed: float, first: float, second: float
) -> None:
    state = np.array([0, 0, yaw, speed, 0, 0])
    middle = MODEL.transition(state, first)
    onward = MODEL.jacobian(middle, second)
    in_two = onward @ MODEL.process_noise(state, first) @ onward.T + MODEL.process_noise(
        middle, second
    )
    np.testing.assert_allclose(
        in_two, MODEL.process_noise(state, first + second), rtol=1e-4, atol=1e-6 * speed**2
    )


def test_many_states_at_once_are_each_one_alone() -> None:
    states = np.array([[0, 0, 0.1, 5, 0.2, 1], [1, 2, 3, 0, 0, 0], [0, 0, -2, 9, -1, -3.0]])
    steps_s = np.array([0.1, 0.2, 0.3])
    for function in (MODEL.transition, MODEL.jacobian, MODEL.process_noise):
        alone = [function(state, dt_s) for state, dt_s in zip(states, steps_s, strict=True)]
        np.testing.assert_allclose(function(states, steps_s), np.stack(alone), atol=1e-12)


@pytest.mark.parametrize("forecaster", [TurnRateKalman(), TurnRateUnscented()])
def test_a_filter_learns_speed_and_turn_rate_and_stays_positive_definite(
    forecaster: TurnRateKalman,
) -> None:
    times_s = np.cumsum([0.1, 0.05, 0.2, 0.1, 0.1, 0.15, 0.1, 0.1])
    start = np.array([0, 0, 3.0, 8.0, 0.5])  # its yaw passes pi
    measured = np.stack([fitted("turn-rate").transition(start, t)[:3] for t in times_s])
    state, covariance = forecaster.filtered(measured, times_s)
    assert state[3] == pytest.approx(8.0, abs=0.05)
    assert state[4] == pytest.approx(0.5, abs=0.02)
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance)[0] > 0


def test_the_plane_is_the_one_the_camera_travels_on() -> None:
    # A camera that looks 5 degrees above its way: what it sees as travel goes down in its own
    # frame.
    pitch = np.radians(5.0)
    past = drive([0, 10 * np.sin(pitch), 10 * np.cos(pitch), 0, 0, 0], np.arange(10) * 0.1)
    plane = past_motion.vehicle_from_cam(past)
    np.testing.assert_allclose(plane, planar.level_vehicle_from_cam(pitch), atol=2e-3)
    on_plane = plane[:3, :3] @ (past.world_from_cam[-1, :3, 3] - past.world_from_cam[0, :3, 3])
    assert abs(on_plane[1]) < 0.02


def test_a_standing_camera_says_nothing_about_its_plane() -> None:
    past = drive([0, 0, 0, 0, 0, 0], np.arange(5) * 0.1)
    np.testing.assert_allclose(past_motion.vehicle_from_cam(past), np.eye(4))


def test_twists_are_on_an_even_grid_and_are_continued_backwards() -> None:
    twist = [0.1, 0.0, 8.0, 0.0, 0.3, 0.0]
    irregular = drive(twist, np.array([0, 0.07, 0.2, 0.31, 0.33, 0.5]))
    np.testing.assert_allclose(
        past_motion.twists_per_s(irregular, 0.1, 9), np.tile(twist, (9, 1)), atol=1e-9
    )


def test_a_past_without_metres_is_scaled_to_the_assumed_speed() -> None:
    past = drive([0, 0, 1.0, 0, 0, 0], np.arange(4) * 0.1, is_metric=False)
    metric, metres_per_unit = past_motion.in_metres(past)
    assert metric.is_metric
    assert metres_per_unit == pytest.approx(9.0)
    np.testing.assert_allclose(metric.world_from_cam[:, 2, 3], [0, 0.9, 1.8, 2.7])
    assert past_motion.in_metres(drive([0, 0, 0, 0, 0, 0], np.arange(4) * 0.1, False))[1] == 1.0


@pytest.mark.parametrize("times_s", [[0.3], [0.2], [np.nan]])
def test_a_future_that_is_not_later_is_refused(times_s: list[float]) -> None:
    with pytest.raises(BadData, match="later than the last"):
        past_motion.seconds_ahead(drive([0, 0, 1, 0, 0, 0], np.arange(4) * 0.1), np.array(times_s))


def mixture(weights: list[float], means: list[list[float]]) -> PlanarForecast:
    covariances = np.tile(np.diag([4.0, 1.0, 0.01]), (len(weights), 1, 1, 1))
    return PlanarForecast(
        np.array(weights), np.array(means)[:, None], covariances, np.eye(4), np.eye(4)
    )


def test_the_density_is_the_gaussians_and_wraps_yaw() -> None:
    forecast = mixture([1.0], [[0, 10, np.pi - 0.01]])
    at_mean = -0.5 * np.log((2 * np.pi) ** 3 * 4 * 1 * 0.01)
    states = np.array([[[0, 10, np.pi - 0.01]], [[2, 10, np.pi - 0.01]], [[0, 10, -np.pi + 0.09]]])
    # the second is one deviation (2 m) off, the third one of 0.1 rad across the seam
    np.testing.assert_allclose(
        forecast.log_density(states)[:, 0], at_mean - np.array([0, 0.5, 0.5])
    )


def test_samples_are_of_both_modes_by_weight() -> None:
    states = mixture([0.25, 0.75], [[-50, 0, 0], [50, 0, 0]]).sample(4000, seed=1)
    assert (states[:, 0, 0] > 0).mean() == pytest.approx(0.75, abs=0.03)
    assert states[states[:, 0, 0] > 0][:, 0, 0].std() == pytest.approx(2.0, abs=0.1)


def filterpys_unscented(model: VehicleModel) -> UnscentedKalmanFilter:
    points = MerweScaledSigmaPoints(model.num_states, alpha=0.5, beta=2.0, kappa=0.0)
    unscented = UnscentedKalmanFilter(
        model.num_states, 3, 0.1, lambda state: state[:3], model.transition, points
    )
    unscented.x, unscented.P = np.array([1.0, 2.0, 0.3, 8.0, 0.2]), 0.01 * np.eye(5)
    unscented.Q, unscented.R = model.process_noise(unscented.x, 0.1), model.measurement_noise
    return unscented


def test_the_unscented_filter_is_filterpys() -> None:
    model, measured = fitted("turn-rate"), np.array([1.2, 2.7, 0.32])
    filterpys = filterpys_unscented(model)
    predicted = TurnRateUnscented().prediction((filterpys.x, filterpys.P), 0.1)
    filterpys.predict()
    np.testing.assert_allclose(predicted[0], filterpys.x, atol=1e-14)
    np.testing.assert_allclose(predicted[1], filterpys.P, atol=1e-14)
    state, covariance = joseph_update(predicted, measured, model.measurement_noise)
    filterpys.update(measured)
    np.testing.assert_allclose(state, filterpys.x, atol=1e-12)
    np.testing.assert_allclose(covariance, filterpys.P, atol=1e-14)


def test_many_extended_filters_at_once_are_each_filterpys() -> None:
    model, dt_s = fitted("acceleration"), 0.1
    states, measured = np.random.default_rng(0).standard_normal((2, 5, 6))
    covariance = np.diag([0.1, 0.2, 0.03, 4.0, 0.5, 1.0]) + 0.01
    predicted = extended_prediction(model, (states, np.tile(covariance, (5, 1, 1))), dt_s)
    found = joseph_update(predicted, measured[:, :3], model.measurement_noise)
    extended = ExtendedKalmanFilter(dim_x=6, dim_z=3)
    extended.R = model.measurement_noise
    for number, state in enumerate(states):
        extended.x, extended.P = state, covariance
        extended.F, extended.Q = model.jacobian(state, dt_s), model.process_noise(state, dt_s)
        extended.predict()
        extended.x = model.transition(state, dt_s)  # filterpy's own is linear: F @ x
        extended.update(measured[number, :3], lambda x: np.eye(3, len(x)), lambda x: x[:3])
        np.testing.assert_allclose(found[0][number], extended.x, atol=1e-9)
        np.testing.assert_allclose(found[1][number], extended.P, atol=1e-9)
