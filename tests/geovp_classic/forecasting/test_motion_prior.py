"""The motion prior on motions with a known continuation, and on random ones."""

import numpy as np
import pytest

from geovp_classic.errors import BadData
from geovp_classic.forecasting import motion_network
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray, Trajectory

STEP_S = 0.1037


def drive(
    speed_m_s: float, turn_rad_s: float, num_steps: int, is_metric: bool = True
) -> Trajectory:
    times_s = np.arange(num_steps) * STEP_S
    twist = np.array([0, 0, speed_m_s, 0, turn_rad_s, 0])
    return Trajectory(se3.exp(times_s[:, None] * twist), times_s, is_metric)


def ahead_of(past: Trajectory) -> FloatArray:
    return past.times_s[-1] + STEP_S * np.arange(1, 21)


def states_of(futures: FloatArray, past: Trajectory) -> FloatArray:
    return planar.reduce(futures, past.world_from_cam[-1], planar.level_vehicle_from_cam())


def test_a_straight_road_continues_straight() -> None:
    past = drive(10.0, 0.0, 10)
    states = states_of(MotionPrior().forecast(past, ahead_of(past)), past)[0]
    # Exactly straight by symmetry; drivers about keep their speed: 20 steps are 20.7 m.
    np.testing.assert_allclose(states[:, [0, 2]], 0.0, atol=1e-6)
    assert states[-1, 1] == pytest.approx(20.7, abs=2.0)


def test_a_mirrored_past_has_the_mirrored_future() -> None:
    left, right = (drive(7.0, turn, 10) for turn in (-0.4, 0.4))
    ahead = [
        states_of(MotionPrior().forecast(past, ahead_of(past)), past)[0] for past in (left, right)
    ]
    np.testing.assert_allclose(ahead[0], ahead[1] * motion_network.MIRRORED_STATE, atol=1e-6)
    assert 0.1 < ahead[1][-1, 2] < 0.4 * 20 * STEP_S * 1.5  # the turn continues and decays


def test_a_single_pose_has_no_distribution() -> None:
    with pytest.raises(BadData, match="at least two"):
        MotionPrior().distribution(drive(5.0, 0.0, 1), np.array([1.0]))


def test_scale_free_futures_are_in_the_unit_of_the_past() -> None:
    metric, free = drive(9.2, 0.2, 10), drive(1.0, 0.2, 10, is_metric=False)
    ahead, free_ahead = (
        MotionPrior().forecast(p, ahead_of(p))[0, :, :3, 3] for p in (metric, free)
    )
    last, free_last = metric.world_from_cam[-1, :3, 3], free.world_from_cam[-1, :3, 3]
    np.testing.assert_allclose(9.2 * (free_ahead - free_last), ahead - last, rtol=0.02, atol=0.02)


def test_the_path_is_smooth_between_and_beyond_the_steps_of_the_grid() -> None:
    past = drive(8.0, 0.3, 10)
    times_s = past.times_s[-1] + np.arange(1, 400) * 0.01  # 4 s, the grid ends at 2.2 s
    positions = MotionPrior().forecast(past, times_s)[0, :, :3, 3]
    speeds = np.linalg.norm(np.diff(positions, axis=0), axis=-1) / 0.01
    assert np.abs(np.diff(speeds)).max() < 0.3  # m/s within a hundredth of a second
    assert np.ptp(speeds[-150:]) < 0.2


def test_the_damped_turn_brakes_to_rest_and_then_does_not_turn() -> None:
    twists = np.zeros((1, 9, 6))
    twists[0, :, 2] = np.linspace(2.6, 1.0, 9)  # 0.2 m/s per step slower: rest after five steps
    twists[0, :, 4] = 0.5
    path = motion_network.damped_turn(twists, 0.1, 10)[0]
    # Five steps turn by .5 rad/s * .1 s, each by .95 of the one before.
    np.testing.assert_allclose(np.diff(path[:5, 2]), 0.05 * 0.95 ** np.arange(2, 6))
    np.testing.assert_allclose(path[5:], path[4][None].repeat(5, 0), atol=1e-12)
    # A camera without speed, which is not in a vehicle, goes on turning.
    twists[0, :, 2] = 0.0
    path = motion_network.damped_turn(twists, 0.1, 10)[0]
    np.testing.assert_allclose(path[:, 2], np.cumsum(0.05 * 0.95 ** np.arange(1, 11)))
