"""The selected forecaster for a car, a phone, a drone, and cameras that hover, turn or go aside."""

import numpy as np
import pytest

from geovp_classic.forecasting.constant import ConstantTurn, ConstantVelocity, Hold
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.forecasting.persistent_turn import PersistentTurn
from geovp_classic.forecasting.selected import DrivingTest, Selected
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory

STEP_S = 0.1
TIMES_S = STEP_S * np.arange(10, 30)


def path(
    twist: list[float],
    shake_rad_s: float = 0.0,
    shake_m_s: float = 0.0,
    is_metric: bool = False,
) -> Trajectory:
    """Return 30 poses; (v, w) per second, and white noise on both."""
    noise = np.random.default_rng(0).standard_normal((29, 6))
    rates = np.array(twist) + noise * np.repeat([shake_m_s, shake_rad_s], 3)
    poses = [np.eye(4)]
    for step in se3.exp(STEP_S * rates):
        poses.append(poses[-1] @ step)
    return Trajectory(np.stack(poses), STEP_S * np.arange(30), is_metric)


CAR = path([0, 0, 10.0, 0, 0.1, 0], 0.01, 0.02, is_metric=True)
CAMERAS = {
    "phone": path([0, 0, 1.3, 0, 0, 0], 0.4, 0.3),
    "drone": path([1.0, -2.0, 6.0, 0, 0.2, 0], 0.02, 0.1),
    "sideways": path([1.4, 0, 0, 0, 0, 0], 0.03, 0.05),
    "hovering": path([0, 0, 0, 0, 0, 0], 0.02, 0.05),
    "pure rotation": path([0, 0, 0, 0, 0.4, 0], 0.01),
}


def error_rad(ahead: FloatArray, truth: FloatArray, depth: float) -> float:
    twists = se3.log(se3.inverse(truth) @ ahead)
    twists[:, :3] /= depth
    return float(np.linalg.norm(twists, axis=1).mean())


def test_a_car_gets_the_motion_prior() -> None:
    assert isinstance(Selected().select(CAR[:10]), MotionPrior)


@pytest.mark.parametrize("name", CAMERAS)
def test_another_camera_does_not_get_the_motion_prior(name: str) -> None:
    assert not isinstance(Selected().select(CAMERAS[name][:10]), MotionPrior)


@pytest.mark.parametrize("name", CAMERAS)
def test_the_forecast_is_about_as_good_as_the_best_of_others(name: str) -> None:
    whole = CAMERAS[name]
    forecasters = Selected(), PersistentTurn(variance_factor=2.0), ConstantTurn(num_steps=3), Hold()
    depth = 10.0 * se3.step_lengths(whole.world_from_cam).mean() or 1.0
    truth = whole.world_from_cam[10:]
    errors = [
        error_rad(each.forecast(whole[:10], TIMES_S)[0], truth, depth) for each in forecasters
    ]
    assert errors[0] <= 1.5 * min(errors[1:])


def test_exact_continuations_are_found() -> None:
    circle = path([0, 0, 10.0, 0, 1.0, 0])[:10]
    candidates = (Hold(), ConstantVelocity(), ConstantTurn())
    assert Selected(candidates=candidates).select(circle) == ConstantTurn()
    straight = path([3.0, 0, 10.0, 0, 0, 0])[:10]
    assert Selected(candidates=(Hold(), ConstantVelocity())).select(straight) == ConstantVelocity()
    stationary = path([0, 0, 0, 0, 0, 0])[:10]
    assert Selected(candidates=candidates).select(stationary) == Hold()


@pytest.mark.parametrize(
    ("twist", "expected"),
    [
        ([0, 0, 8.0, 0, 0.3, 0], True),
        ([0, 0, -8.0, 0, 0, 0], False),  # backwards
        ([8.0, 0, 0, 0, 0, 0], False),  # sideways
        ([0, -4.0, 4.0, 0, 0, 0], False),  # climbs
        ([0, 0, 0.1, 0, 0, 0], False),  # too slow to tell
        ([0, 0, 1.0, 0, 1.0, 0], False),  # turns on the spot
    ],
)
def test_what_counts_as_driving(twist: list[float], expected: bool) -> None:
    assert DrivingTest().passes(path(twist, is_metric=True)[:10]) is expected
    assert not DrivingTest().passes(path(twist, is_metric=False)[:10])


def test_noise_in_a_step_of_two_milliseconds_is_no_shake() -> None:
    past = path([0, 0, 8.0, 0, 0, 0], is_metric=True)[:10]
    pose = past.world_from_cam[-1] @ se3.exp(np.array([0, 0, 0.016, 0.002, 0, 0]))
    poses = np.concatenate([past.world_from_cam, pose[None]])
    times_s = np.append(past.times_s, past.times_s[-1] + 0.002)
    assert DrivingTest().passes(Trajectory(poses, times_s, is_metric=True))


def test_a_short_past_is_forecast_by_the_default() -> None:
    assert isinstance(Selected().select(CAR[:3]), MotionPrior)
    assert Selected().select(CAMERAS["phone"][:3]) == PersistentTurn()
    single = CAMERAS["phone"][:1]
    np.testing.assert_allclose(Selected().forecast(single, TIMES_S)[0, -1], np.eye(4))


def test_the_prior_can_be_switched_off() -> None:
    assert not isinstance(Selected(prior=None).select(CAR[:10]), MotionPrior)
