"""Unmeasured intervals of recordings are detected and corrected by registered poses."""

import os
from pathlib import Path

import numpy as np
import pytest

from geovp_classic.data.kitti import Kitti
from geovp_classic.geometry import pinhole, se3
from geovp_classic.pose_refinement.registration import Registration
from geovp_classic.pose_refinement.unmeasured_intervals import (
    Interval,
    IntervalDetector,
    UnmeasuredIntervals,
)
from geovp_classic.types import FloatArray

NOW = 9  # the reference
TIMES_S = (np.arange(30) - NOW) * 0.1
FIRST, LAST = 5, 16  # the last measured pose before the interval, and the first one after it


def driven(times_s: FloatArray) -> FloatArray:
    """Return poses [T, 4, 4] of a car that pitches, turns and rolls, at changing speed."""
    pitch = 0.006 * np.sin(2 * np.pi * 0.9 * times_s)
    yaw = 0.1 * np.sin(2 * np.pi * 0.3 * times_s)
    roll = 0.006 * np.sin(2 * np.pi * 0.5 * times_s + 1)
    ahead = 10 * times_s + np.cos(times_s)
    zero = np.zeros_like(ahead)
    turned = se3.exp(np.stack([zero, zero, zero, pitch, yaw, roll], axis=1))
    return se3.compose(turned[:, :3, :3], np.stack([zero, zero, ahead], axis=1))


def recorded(first: int = FIRST, last: int = LAST, phase_s: float = 0.0) -> FloatArray:
    """Return the drive with uniform motion between two steps, as recorded without measurements."""
    poses = driven(TIMES_S + phase_s)
    between = slice(first + 1, last)
    fraction = (TIMES_S[between] - TIMES_S[first]) / (TIMES_S[last] - TIMES_S[first])
    ends = poses[[first, last]]
    positions = ends[0, :3, 3] + fraction[:, None] * (ends[1] - ends[0])[:3, 3]
    rotations = se3.interpolate(ends, np.array([0.0, 1.0]), fraction)[:, :3, :3]
    poses[between] = se3.compose(rotations, positions)
    poses[last] = se3.turned(
        poses[last], np.array([1e-4, 0, 0])
    )  # resampling blurs: the last step isn't quite even
    return poses


def from_now(world_from_cam: FloatArray) -> FloatArray:
    """Return poses relative to the reference."""
    return se3.inverse(world_from_cam[NOW]) @ world_from_cam


def errors_deg(given: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return errors of the given future rotations, and what the correction leaves of them."""
    (interval,) = (
        interval
        for interval in IntervalDetector().find(given, TIMES_S)
        if interval.inside(len(given))[NOW]
    )
    seen = from_now(driven(TIMES_S))
    expected = UnmeasuredIntervals().errors(interval, from_now(given), seen[: NOW + 1], TIMES_S)
    err = se3.turn(from_now(given)[NOW + 1 :], seen[NOW + 1 :])
    return np.degrees(err), np.degrees(err - expected)


def test_uniform_motion_is_detected() -> None:
    assert IntervalDetector().find(recorded(), TIMES_S) == [Interval(FIRST, LAST)]
    inside = Interval(FIRST, LAST).inside(30)
    np.testing.assert_array_equal(np.flatnonzero(inside), np.arange(FIRST + 1, LAST))


def test_ends_outside_the_sequence_are_unknown() -> None:
    assert IntervalDetector().find(recorded()[FIRST + 2 :], TIMES_S[FIRST + 2 :]) == [
        Interval(None, LAST - FIRST - 2)
    ]
    assert IntervalDetector().find(recorded()[: LAST - 1], TIMES_S[: LAST - 1]) == [
        Interval(FIRST, None)
    ]
    np.testing.assert_array_equal(
        np.flatnonzero(Interval(FIRST, None).inside(12)), np.arange(FIRST + 1, 12)
    )
    np.testing.assert_array_equal(np.flatnonzero(Interval(None, 3).inside(12)), np.arange(3))


def test_measured_and_stationary_poses_are_not_detected() -> None:
    assert IntervalDetector().find(driven(TIMES_S), TIMES_S) == []
    assert IntervalDetector().find(np.tile(np.eye(4), (30, 1, 1)), TIMES_S) == []
    assert IntervalDetector().find(np.eye(4)[None], TIMES_S[:1]) == []


def test_an_interval_with_both_ends_is_corrected() -> None:
    err, left = errors_deg(recorded())
    assert np.abs(err[LAST - NOW :]).max() > 0.4
    np.testing.assert_allclose(left[LAST - NOW - 1 :], 0, atol=0.02)
    assert np.sqrt((left**2).mean()) < 0.5 * np.sqrt((err**2).mean())


def test_errors_are_constant_after_the_interval() -> None:
    (interval,) = IntervalDetector().find(recorded(), TIMES_S)
    expected = UnmeasuredIntervals().errors(
        interval, from_now(recorded()), from_now(driven(TIMES_S))[: NOW + 1], TIMES_S
    )
    behind = expected[LAST - NOW - 1 :]
    np.testing.assert_allclose(behind, np.broadcast_to(behind[0], behind.shape), atol=1e-12)


def test_an_interval_without_a_beginning_is_corrected_on_average() -> None:
    begin, before, after = FIRST + 1, [], []
    for phase_s in np.linspace(0, 5, 40):
        given, seen = (
            from_now(recorded(FIRST, NOW + 4, phase_s)),
            from_now(driven(TIMES_S + phase_s)),
        )
        (interval,) = IntervalDetector().find(given[begin:], TIMES_S[begin:])
        assert interval.first is None
        expected = UnmeasuredIntervals().errors(
            interval, given[begin:], seen[begin : NOW + 1], TIMES_S[begin:]
        )
        err = se3.turn(given, seen)[NOW + 1 :]
        before.append(err[-1])
        after.append(err[-1] - expected[-1])
    left = np.sqrt(np.mean(np.square(after), axis=0) / np.mean(np.square(before), axis=0))
    np.testing.assert_array_less(left, [0.6, 0.5, 1.0])


def test_an_interval_without_an_end_is_not_corrected() -> None:
    given, seen = from_now(recorded()), from_now(driven(TIMES_S))
    left = slice(None, LAST - 1)
    (interval,) = IntervalDetector().find(given[left], TIMES_S[left])
    np.testing.assert_array_equal(
        UnmeasuredIntervals().errors(interval, given[left], seen[: NOW + 1], TIMES_S[left]), 0
    )


@pytest.mark.parametrize("turned", [np.array([0.0, 0.5, 0.0]), np.array([0.1, 2.0, -0.1])])
def test_the_world_frame_does_not_matter(turned: FloatArray) -> None:
    world = se3.exp(np.concatenate([[1.0, 2.0, 3.0], turned]))
    assert IntervalDetector().find(world @ recorded(), TIMES_S) == [Interval(FIRST, LAST)]


def test_the_interval_in_kitti_00_is_corrected() -> None:
    root = os.environ.get("GEOVP_TEST_DATA")
    if not root:
        pytest.skip("GEOVP_TEST_DATA is not set: needs kitti/sequences/00")
    data = Kitti(
        Path(root) / "kitti", sequences=("00[341:371)",), size_px=(128, 128), with_full=True
    )
    clip = data[0]
    assert clip.trajectory is not None
    assert clip.full is not None
    given, times_s = clip.trajectory.world_from_cam, clip.times_s - clip.times_s[NOW]
    assert IntervalDetector().find(given, times_s) == [Interval(5, 21)]  # frames 346 to 362
    grey = np.stack([pinhole.grey8(frame) for frame in clip.full.frames[:24]])
    seen, witness = (
        Registration()
        .register(grey[:count], clip.full.intrinsics, given[:count], NOW)
        .world_from_cam
        for count in (NOW + 1, 24)
    )
    given, seen, witness = (se3.inverse(given[NOW]) @ poses for poses in (given, seen, witness))
    err = np.degrees(se3.turn(given[22], witness[22]))
    left = err - np.degrees(
        UnmeasuredIntervals().errors(Interval(5, 21), given, seen, times_s)[22 - NOW - 1]
    )
    assert np.linalg.norm(err) > 1
    assert np.linalg.norm(left) < 0.3
