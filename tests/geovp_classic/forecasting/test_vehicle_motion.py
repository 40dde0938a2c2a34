"""Motion model of a vehicle, analysis of the past motion, and the mixture over the plane."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.motion_models import VehicleModel
from geovp_classic.forecasting.planar_forecaster import PlanarForecast
from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray, Trajectory
from geovp_classic.types.speed_prior import SpeedPrior

MODEL = VehicleModel(
    turn_damping_hz=0.0,
    acceleration_damping_hz=0.0,
    lever_arm_m=0.0,
    slip_noise=0.02,
    speed_noise=0.5,
    turn_noise=0.1,
    acceleration_noise=0.3,
)


def drive(twist_per_s: list[float], times_s: FloatArray, is_metric: bool = True) -> Trajectory:
    return Trajectory(se3.exp(times_s[:, None] * np.array(twist_per_s)), times_s, is_metric)


def test_a_quarter_circle_in_one_step() -> None:
    # 10 m/s, pi/2 rad/s: radius 20/pi; a quarter circle ends one radius ahead and one to the right.
    state = np.array([0, 0, 0, 10.0, np.pi / 2])
    later = MODEL.transition(state, 1.0)
    np.testing.assert_allclose(
        later, [20 / np.pi, 20 / np.pi, np.pi / 2, 10, np.pi / 2], atol=1e-12
    )


def test_a_camera_ahead_of_the_axle_swings_outwards() -> None:
    # A turn of 90 degrees on the spot moves a camera 2 m ahead of the axle from (0, 2) to (2, 0).
    swung = replace(MODEL, lever_arm_m=2.0).transition(np.array([0, 2.0, 0, 0, np.pi / 2]), 1.0)
    np.testing.assert_allclose(swung[:2], [2, 0], atol=1e-12)


@pytest.mark.parametrize("damping_hz", [0.0, 0.3])
def test_braking_in_a_turn_ends_at_the_same_place_in_one_step_or_in_many(damping_hz: float) -> None:
    model = replace(MODEL, acceleration_damping_hz=damping_hz)
    start = np.array([0, 0, 0, 0.5, 0.5, -1.0])  # a radius of 1 m
    in_one = model.transition(start, 3.0)
    in_many = start
    for _ in range(60):
        in_many = model.transition(in_many, 0.05)
    np.testing.assert_allclose(in_many, in_one, atol=2e-3)


def test_a_car_that_has_stopped_does_not_turn() -> None:
    # It stops after 0.5 s and 0.125 m, on an arc of 1 m radius: 0.125 rad, or 7 degrees.
    later = MODEL.transition(np.array([0, 0, 0, 0.5, 0.5, -1.0]), 10.0)
    assert later[2] == pytest.approx(0.125)
    np.testing.assert_allclose(later[3:], 0.0)


def test_speeding_up_keeps_the_turn_rate() -> None:
    later = MODEL.transition(np.array([0, 0, 0, 0.0, 0.2, 1.0]), 2.0)
    np.testing.assert_allclose(later[2:5], [0.4, 2.0, 0.2])


def test_the_turn_rate_decays_exponentially() -> None:
    damped = replace(MODEL, turn_damping_hz=0.5).transition(np.array([0, 0, 0, 5.0, 1.0]), 2.0)
    assert damped[4] == pytest.approx(np.exp(-1))
    assert damped[2] == pytest.approx((1 - np.exp(-1)) / 0.5)


@given(st.floats(-3, 3), st.floats(0.5, 30), st.floats(0.01, 0.5), st.floats(0.01, 0.5))
def test_two_short_steps_add_the_noise_of_a_long_step(
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


def test_twists_of_a_past_that_is_shorter_than_a_step_are_its_mean() -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[1:, 2, 3] = 0.1  # moves, and stops
    past = Trajectory(poses, np.array([0, 0.01, 0.02]), is_metric=True)
    np.testing.assert_allclose(past_motion.twists_per_s(past, 0.1, 2)[:, 2], [5, 5])


def test_the_camera_travels_on_its_plane() -> None:
    # The camera looks 5 degrees above its direction of travel.
    pitch = np.radians(5.0)
    past = drive([0, 10 * np.sin(pitch), 10 * np.cos(pitch), 0, 0, 0], np.arange(10) * 0.1)
    plane = past_motion.vehicle_from_cam(past)
    np.testing.assert_allclose(plane, planar.level_vehicle_from_cam(pitch), atol=2e-3)
    on_plane = plane[:3, :3] @ (past.world_from_cam[-1, :3, 3] - past.world_from_cam[0, :3, 3])
    assert abs(on_plane[1]) < 0.02


def test_twists_are_resampled_and_continued_backwards() -> None:
    twist = [0.1, 0.0, 8.0, 0.0, 0.3, 0.0]
    irregular = drive(twist, np.array([0, 0.07, 0.2, 0.31, 0.33, 0.5]))
    np.testing.assert_allclose(
        past_motion.twists_per_s(irregular, 0.1, 9), np.tile(twist, (9, 1)), atol=1e-9
    )


def test_a_past_without_metres_is_scaled_to_the_assumed_speed() -> None:
    past = drive([0, 0, 1.0, 0, 0, 0], np.arange(4) * 0.1, is_metric=False)
    metric, metres_per_unit = past_motion.in_metres(past)
    assert metric.is_metric
    assert metres_per_unit == pytest.approx(SpeedPrior().median_m_s)
    np.testing.assert_allclose(metric.world_from_cam[:, 2, 3], [0, 0.92, 1.84, 2.76])  # 9.2 m/s
    assert past_motion.in_metres(drive([0, 0, 0, 0, 0, 0], np.arange(4) * 0.1, False))[1] == 1.0


COVARIANCE = np.diag([4.0, 1.0, 0.01])  # of x, z and yaw
LOG_DENSITY_AT_MEAN = -0.5 * np.log((2 * np.pi) ** 3 * 4 * 1 * 0.01)


def mixture(weights: list[float], means: list[list[float]]) -> PlanarForecast:
    covariances = np.tile(COVARIANCE, (len(weights), 1, 1, 1))
    return PlanarForecast(
        np.array(weights), np.array(means)[:, None], covariances, np.eye(4), np.eye(4)
    )


def test_the_log_density_of_a_gaussian_with_wrapped_yaw() -> None:
    forecast = mixture([1.0], [[0, 10, np.pi - 0.01]])
    states = np.array([[[0, 10, np.pi - 0.01]], [[2, 10, np.pi - 0.01]], [[0, 10, -np.pi + 0.09]]])
    # the second is one deviation (2 m) off, the third one of 0.1 rad across the seam
    np.testing.assert_allclose(
        forecast.log_density(states)[:, 0], LOG_DENSITY_AT_MEAN - np.array([0, 0.5, 0.5])
    )


def test_a_mode_without_weight_adds_nothing_to_the_density() -> None:
    states = np.array([[[0.0, 10, 0]]])
    for weight in (0.0, 1e-320):  # the second one is denormal
        forecast = mixture([weight, 1.0], [[0, 10, 0], [2, 10, 0]])  # one deviation apart
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            np.testing.assert_allclose(forecast.log_density(states), LOG_DENSITY_AT_MEAN - 0.5)


def test_samples_come_from_both_modes_by_weight() -> None:
    states = mixture([0.25, 0.75], [[-50, 0, 0], [50, 0, 0]]).sample(4000, seed=1)
    assert (states[:, 0, 0] > 0).mean() == pytest.approx(0.75, abs=0.03)
    assert states[states[:, 0, 0] > 0][:, 0, 0].std() == pytest.approx(2.0, abs=0.1)
