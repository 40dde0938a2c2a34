"""Prediction of heave, pitch and roll over the plane."""

from pathlib import Path

import numpy as np
import pytest

from geovp_classic.errors import BadData
from geovp_classic.forecasting import body_motion
from geovp_classic.forecasting.body_motion import BodyForecast, BodyMotion
from geovp_classic.forecasting.kalman import TurnRateKalman
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory

STEP_S = 0.1037
SPRING_HZ, PITCH_RAD = 1.3, 0.01


def bouncing(
    num_poses: int, phase_rad: float, speed_m_s: float = 10.0, roll_rad: float = 0.0
) -> Trajectory:
    """Drive straight ahead while the body pitches, and rolls a quarter of a period later."""
    times_s = STEP_S * np.arange(num_poses)
    angle = 2 * np.pi * SPRING_HZ * times_s + phase_rad
    twists = np.zeros((num_poses, 6))
    twists[:, 3], twists[:, 5] = PITCH_RAD * np.sin(angle), roll_rad * np.cos(angle)
    poses = se3.exp(twists)
    poses[:, 2, 3] = speed_m_s * times_s
    return Trajectory(poses, times_s, is_metric=True)


def pitch_error_rad(forecast: FloatArray, truth: Trajectory, past: Trajectory) -> FloatArray:
    pitch, true_pitch = (
        body_motion.over_plane(poses, past)[:, 1] for poses in (forecast, truth.world_from_cam)
    )
    return np.abs(pitch - true_pitch)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return coefficients that continue a sine: each step is 2 cos(angle) times the last one less
    the one before.
    """
    angle = 2 * np.pi * SPRING_HZ * STEP_S
    before, last = np.eye(2)  # as combinations of the last two steps of the past
    pitch = np.zeros(2)
    weights = np.zeros((9, 6, 20, 3))
    for step in range(20):
        before, last = last, 2 * np.cos(angle) * last - before
        pitch = pitch + last
        weights[-2:, 3, step, 1] = STEP_S * pitch
    path = tmp_path / "sine.npz"
    others = {"step_s": STEP_S, "scale": np.ones(54), "spread": np.zeros((5, 60))}
    np.savez(path, weights=weights.reshape(54, 60), degrees=np.ones(3), **others)  # type: ignore[arg-type]
    return path


def test_a_periodic_bounce_is_predicted(file: Path) -> None:
    drive = bouncing(30, phase_rad=0.4, speed_m_s=9.0, roll_rad=0.005)
    past, future = drive[:10], drive[10:]
    with_it, without = (
        MotionPrior(body_motion=body).forecast(past, future.times_s)[0]
        for body in (BodyMotion(file), None)
    )
    held, predicted = (pitch_error_rad(poses, future, past).mean() for poses in (without, with_it))
    assert held > 0.4 * PITCH_RAD  # mean distance of a sine from its last value
    assert predicted < 0.05 * held


def test_body_motion_keeps_position_and_heading() -> None:
    past = bouncing(10, 0.4)
    times_s = past.times_s[-1] + STEP_S * np.arange(1, 21)
    with_it, without = (
        TurnRateKalman(body_motion=body).forecast(past, times_s)[0] for body in (BodyMotion(), None)
    )
    off = se3.log(se3.inverse(without) @ with_it)
    np.testing.assert_allclose(off[:, [0, 2, 4]], 0, atol=1e-3)
    assert np.abs(off[:, 3]).max() > 1e-3


def test_an_unreadable_file_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "none.npz"
    path.write_bytes(b"no archive")
    past = bouncing(10, 0.0)
    with pytest.raises(BadData, match=r"none\.npz cannot be read"):
        BodyMotion(path).added_to(np.eye(4)[None], past, past.times_s[-1:] + 0.1)


def test_the_interval_of_students_t() -> None:
    forecast = BodyForecast(
        np.array([[0.1, 0.0, 0.0]]), np.array([[0.5, 1.0, 2.0]]), np.array([4.0, 4.0, 4.0])
    )
    ranks = forecast.ranks(
        np.array([[0.1 + 0.5 * 2.776, 0.741, 0.0]])
    )  # a table's 97.5 % and 75 % for 4 degrees
    np.testing.assert_allclose(ranks, [[0.95, 0.5, 0.0]], atol=1e-3)
    drawn = forecast.sample(40000, seed=0)[:, 0]
    np.testing.assert_allclose(np.median(drawn, axis=0), [0.1, 0.0, 0.0], atol=0.03)
    assert (np.abs(drawn[:, 2]) < 2 * 2.776).mean() == pytest.approx(0.95, abs=0.01)
