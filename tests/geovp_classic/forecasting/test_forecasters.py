"""Properties of all forecasters."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geovp_classic import registry
from geovp_classic.forecasting.interacting import Interacting
from geovp_classic.forecasting.kalman import AccelerationKalman, TurnRateKalman
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.forecasting.planar_forecaster import PlanarForecaster
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory
from tests import registered

FORECASTERS = [registry.build("forecasters", name) for name in registered.names("forecasters")]
IDS = registered.names("forecasters")


def drive(
    times_s: FloatArray, speed: float = 8.0, turn: float = 0.3, unit: float = 1
) -> Trajectory:
    """Return a screw motion, in metres unless the unit is another one."""
    poses = se3.exp(times_s[:, None] * np.array([0, 0.1, speed, 0.01, turn, 0.02]))
    poses[:, :3, 3] /= unit
    return Trajectory(poses, times_s, is_metric=unit == 1)


@pytest.mark.parametrize("forecaster", FORECASTERS, ids=IDS)
@pytest.mark.parametrize("num_poses", [1, 2, 10])
def test_a_stationary_camera_stays(forecaster: Forecaster, num_poses: int) -> None:
    pose = se3.exp(np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]))
    past = Trajectory(np.tile(pose, (num_poses, 1, 1)), 0.1 * np.arange(num_poses), True)
    ahead = forecaster.forecast(past, past.times_s[-1] + np.array([0.1, 2.0]))
    np.testing.assert_allclose(ahead, np.tile(pose, (1, 2, 1, 1)), atol=0.05)


@pytest.mark.parametrize("forecaster", FORECASTERS, ids=IDS)
def test_the_world_frame_and_the_unit_do_not_matter(forecaster: Forecaster) -> None:
    times_s, ahead_s = 0.1 * np.arange(10), np.array([1.0, 2.9])
    past = drive(times_s, unit=2)
    elsewhere = se3.exp(np.array([10.0, -3, 5, 0.3, 2.0, -0.2]))
    moved = Trajectory(elsewhere @ past.world_from_cam, times_s, False)
    ahead = forecaster.forecast(past, ahead_s, 3)
    np.testing.assert_allclose(forecaster.forecast(moved, ahead_s, 3), elsewhere @ ahead, atol=1e-5)
    larger = forecaster.forecast(drive(times_s, unit=0.5), ahead_s, 3)
    np.testing.assert_allclose(larger[..., :3, 3], 4 * ahead[..., :3, 3], rtol=1e-3, atol=1e-3)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(FORECASTERS),
    st.lists(st.floats(0.005, 1.0), min_size=1, max_size=14),
    st.floats(-60, 60),
    st.floats(-30, 30),
    st.lists(st.floats(0.001, 3.0), min_size=1, max_size=5),
    st.sampled_from([1, 7]),
    st.integers(1, 3),
)
def test_futures_are_finite_and_rigid(
    forecaster: Forecaster,
    gaps_s: list[float],
    speed: float,
    turn: float,
    ahead_s: list[float],
    unit: float,
    num_samples: int,
) -> None:
    past = drive(np.cumsum(gaps_s), speed, turn, unit)
    times_s = past.times_s[-1] + np.cumsum(ahead_s)
    futures = forecaster.forecast(past, times_s, num_samples)
    assert np.isfinite(futures).all()
    rotations = futures[..., :3, :3]
    squares = rotations @ np.swapaxes(rotations, -1, -2)
    np.testing.assert_allclose(squares, np.broadcast_to(np.eye(3), squares.shape), atol=1e-6)
    assert (np.linalg.det(rotations) > 0).all()
    for sample in futures:
        Trajectory(sample, times_s, past.is_metric)  # rejects what is not finite and rigid


@pytest.mark.parametrize(
    "forecaster", [MotionPrior(), TurnRateKalman(), AccelerationKalman(), Interacting()]
)
def test_samples_repeat_and_agree_with_a_growing_distribution(forecaster: PlanarForecaster) -> None:
    past, ahead_s = drive(0.1 * np.arange(10)), 0.1 * np.arange(10, 30)
    futures = forecaster.forecast(past, ahead_s, 1000)
    np.testing.assert_allclose(forecaster.forecast(past, ahead_s, 1000), futures)
    forecast = forecaster.distribution(past, ahead_s)
    states = forecast.states_of(futures)[:, -1]
    # Moments of the mixture at the last time
    mean = forecast.weights @ forecast.means[:, -1]
    off = forecast.means[:, -1] - mean
    second = forecast.covariances[:, -1] + off[:, :, None] * off[:, None]
    deviation = np.sqrt(np.diagonal(np.tensordot(forecast.weights, second, axes=1)))
    np.testing.assert_allclose(states.mean(0), mean, atol=0.3 * deviation.max())
    np.testing.assert_allclose(states.std(0), deviation, rtol=0.3)
    volumes = np.tensordot(forecast.weights, np.linalg.det(forecast.covariances), axes=1)
    assert volumes[-1] > 100 * volumes[0]
