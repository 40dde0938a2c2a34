"""Prediction of heave, pitch and roll over the plane."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from geovp_benchmarks.fitting import body_motion as fitting
from geovp_classic.errors import BadData
from geovp_classic.forecasting import body_motion
from geovp_classic.forecasting.body_motion import BodyMotion, Coefficients
from geovp_classic.forecasting.kalman import TurnRateKalman
from geovp_classic.forecasting.motion_network import MIRRORED_TWIST
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.forecasting.sampling import BodyForecast
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


@pytest.fixture(scope="module")
def fitted() -> Coefficients:
    drives = {
        f"{n}": bouncing(150, phase, 8.0 + n % 4, 0.005)
        for n, phase in enumerate(np.linspace(0, 6, 12))
    }
    return fitting.BodyMotionFit().fit(drives, {})


@pytest.fixture(scope="module")
def file(fitted: Coefficients, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("body") / "body.npz"
    np.savez(path, **fitting.packed(fitted))  # type: ignore[arg-type]
    return path


def pitch_error_rad(forecast: FloatArray, truth: Trajectory, past: Trajectory) -> FloatArray:
    pitch, true_pitch = (
        body_motion.over_plane(poses, past)[:, 1] for poses in (forecast, truth.world_from_cam)
    )
    return np.abs(pitch - true_pitch)


def test_a_periodic_bounce_is_predicted(file: Path) -> None:
    drive = bouncing(30, phase_rad=0.4, speed_m_s=9.0, roll_rad=0.005)
    past, future = drive[:10], drive[10:]
    with_it, without = (
        MotionPrior(body_motion=body).forecast(past, future.times_s)[0]
        for body in (BodyMotion(file), None)
    )
    held, predicted = (pitch_error_rad(poses, future, past).mean() for poses in (without, with_it))
    assert held > 0.4 * PITCH_RAD  # mean distance of a sine from its last value
    assert predicted < 0.35 * held


def test_body_motion_keeps_position_and_heading(file: Path) -> None:
    past = bouncing(10, 0.4)
    times_s = past.times_s[-1] + STEP_S * np.arange(1, 21)
    with_it, without = (
        TurnRateKalman(body_motion=body).forecast(past, times_s)[0]
        for body in (BodyMotion(file), None)
    )
    off = se3.log(se3.inverse(without) @ with_it)
    np.testing.assert_allclose(off[:, [0, 2, 4]], 0, atol=1e-3)
    assert np.abs(off[:, 3]).max() > 1e-3


def test_a_mirrored_past_has_the_mirrored_future() -> None:
    twists = np.random.default_rng(0).normal([0, 0, 9.0, 0, 0, 0], 0.1, (1, 9, 6))
    drives = {"a": bouncing(150, 0.3, 9.0, 0.005), "b": bouncing(150, 0.3, 9.0, -0.005)}
    symmetric = fitting.BodyMotionFit().fit(drives, {})
    mirrored = symmetric.means(twists * MIRRORED_TWIST)
    expected = symmetric.means(twists) * fitting.MIRRORED_BODY
    np.testing.assert_allclose(mirrored, expected, atol=2e-3)


def test_steady_straight_driving_is_left_unchanged() -> None:
    times_s = STEP_S * np.arange(30)
    straight = Trajectory(
        se3.compose(np.eye(3), np.outer(times_s, [0, 0, 10.0])), times_s, is_metric=True
    )
    ahead = MotionPrior().forecast(straight[:10], times_s[10:])[0]
    np.testing.assert_allclose(body_motion.over_plane(ahead, straight[:10]), 0, atol=1e-9)


def test_an_unreadable_file_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "none.npz"
    path.write_bytes(b"no archive")
    past = bouncing(10, 0.0)
    with pytest.raises(BadData, match=r"none\.npz cannot be read"):
        BodyMotion(path).added_to(np.eye(4)[None], past, past.times_s[-1:] + 0.1)


def shaken(seed: int, pitch_rad: float) -> Trajectory:
    """Drive straight while the pitch is noise of a few steps, as on a bad road."""
    rng, drive = np.random.default_rng(seed), bouncing(220, 0.0)
    pitch = lfilter([1.0], [1.0, -0.6], pitch_rad * rng.standard_normal(220))
    twists = np.zeros((220, 6))
    twists[:, 3] = pitch
    twists[:, 5] = 0.3 * pitch_rad * rng.standard_normal(220)
    poses = se3.exp(twists)
    poses[:, :3, 3] = drive.world_from_cam[:, :3, 3]
    poses[:, 1, 3] += 0.01 * rng.standard_normal(220)
    return Trajectory(poses, drive.times_s, is_metric=True)


def test_intervals_have_their_coverage_and_grow_with_the_shaking(tmp_path: Path) -> None:
    amounts = np.radians([0.2, 0.4, 0.8, 0.3, 0.6])
    drives = {f"{n}": shaken(n, amounts[n % 5]) for n in range(10)}
    path = tmp_path / "body.npz"
    np.savez(path, **fitting.packed(fitting.BodyMotionFit().fit(drives, {})))  # type: ignore[arg-type]
    ranks, scales = [], []
    for n, drive in enumerate(shaken(100 + n, amounts[n % 5]) for n in range(10)):
        for start in range(0, 180, 10):
            past, future = drive[start : start + 10], drive[start + 10 : start + 30]
            forecast = BodyMotion(path).distribution(past, future.times_s)
            ranks.append(forecast.ranks(body_motion.over_plane(future.world_from_cam, past)))
            scales.append((amounts[n % 5], forecast.scales[5, 1]))
    coverage = [(np.array(ranks) <= nominal).mean(axis=(0, 1)) for nominal in (0.5, 0.9)]
    np.testing.assert_allclose(coverage, [[0.5] * 3, [0.9] * 3], atol=0.08)
    calm, rough = (
        np.mean([scale for amount, scale in scales if amount == level])
        for level in (amounts[0], amounts[2])
    )
    assert rough > 1.5 * calm


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
