"""Where recordings go on evenly nothing measured them, and what the images show says how that errs."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from geovp_classic.data.kitti import Kitti
from geovp_classic.geometry import pinhole, se3
from geovp_classic.pose_refinement import unmeasured_intervals
from geovp_classic.pose_refinement.registration import registered
from geovp_classic.pose_refinement.unmeasured_intervals import Interval
from geovp_classic.types import FloatArray

NOW = 9  # the reference
TIMES_S = (np.arange(30) - NOW) * 0.1
FIRST, LAST = 5, 16  # the last measured pose before the gap, and the first one behind it


def driven(times_s: FloatArray) -> FloatArray:
    """A car that pitches, turns and rolls, at changing speed: world from camera [T, 4, 4]."""
    pitch = 0.006 * np.sin(2 * np.pi * 0.9 * times_s)
    yaw = 0.1 * np.sin(2 * np.pi * 0.3 * times_s)
    roll = 0.006 * np.sin(2 * np.pi * 0.5 * times_s + 1)
    ahead = 10 * times_s + np.cos(times_s)
    zero = np.zeros_like(ahead)
    turned = se3.exp(np.stack([zero, zero, zero, pitch, yaw, roll], axis=1))
    return se3.compose(turned[:, :3, :3], np.stack([zero, zero, ahead], axis=1))


def recorded(first: int = FIRST, last: int = LAST, phase_s: float = 0.0) -> FloatArray:
    """The same, but from one pose to nearly the other at an even rate, as written where nothing was
    measured.
    """
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
    """Reference from camera."""
    return se3.inverse(world_from_cam[NOW]) @ world_from_cam


def errors_deg(given: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How the given rotations err after the reference, and what of this is left."""
    (interval,) = (
        interval
        for interval in unmeasured_intervals.find_intervals(given, TIMES_S)
        if interval.inside(len(given))[NOW]
    )
    seen = from_now(driven(TIMES_S))
    expected = interval.errors(from_now(given), seen[: NOW + 1], TIMES_S)
    err = se3.turn(from_now(given)[NOW + 1 :], seen[NOW + 1 :])
    return np.degrees(err), np.degrees(err - expected)


def test_what_goes_on_evenly_is_found() -> None:
    assert unmeasured_intervals.find_intervals(recorded(), TIMES_S) == [Interval(FIRST, LAST)]
    inside = Interval(FIRST, LAST).inside(30)
    np.testing.assert_array_equal(np.flatnonzero(inside), np.arange(FIRST + 1, LAST))


def test_ends_that_are_not_in_sight_are_unknown() -> None:
    assert unmeasured_intervals.find_intervals(recorded()[FIRST + 2 :], TIMES_S[FIRST + 2 :]) == [
        Interval(None, LAST - FIRST - 2)
    ]
    assert unmeasured_intervals.find_intervals(recorded()[: LAST - 1], TIMES_S[: LAST - 1]) == [
        Interval(FIRST, None)
    ]
    np.testing.assert_array_equal(
        np.flatnonzero(Interval(FIRST, None).inside(12)), np.arange(FIRST + 1, 12)
    )
    np.testing.assert_array_equal(np.flatnonzero(Interval(None, 3).inside(12)), np.arange(3))


def test_measured_poses_and_a_car_that_waits_are_no_gap() -> None:
    assert unmeasured_intervals.find_intervals(driven(TIMES_S), TIMES_S) == []
    assert unmeasured_intervals.find_intervals(np.tile(np.eye(4), (30, 1, 1)), TIMES_S) == []
    assert unmeasured_intervals.find_intervals(np.eye(4)[None], TIMES_S[:1]) == []


def test_a_gap_that_began_in_sight_is_bridged() -> None:
    err, left = errors_deg(recorded())
    assert np.abs(err[LAST - NOW :]).max() > 0.4
    np.testing.assert_allclose(left[LAST - NOW - 1 :], 0, atol=0.02)
    assert np.sqrt((left**2).mean()) < 0.5 * np.sqrt((err**2).mean())


def test_behind_a_gap_errors_stay_what_they_were_at_its_end() -> None:
    (interval,) = unmeasured_intervals.find_intervals(recorded(), TIMES_S)
    expected = interval.errors(from_now(recorded()), from_now(driven(TIMES_S))[: NOW + 1], TIMES_S)
    behind = expected[LAST - NOW - 1 :]
    np.testing.assert_allclose(behind, np.broadcast_to(behind[0], behind.shape), atol=1e-12)


def test_a_gap_that_began_out_of_sight_errs_less_on_average() -> None:
    begin, before, after = FIRST + 1, [], []
    for phase_s in np.linspace(0, 5, 40):
        given, seen = (
            from_now(recorded(FIRST, NOW + 4, phase_s)),
            from_now(driven(TIMES_S + phase_s)),
        )
        (interval,) = unmeasured_intervals.find_intervals(given[begin:], TIMES_S[begin:])
        assert interval.first is None
        expected = interval.errors(given[begin:], seen[begin : NOW + 1], TIMES_S[begin:])
        err = se3.turn(given, seen)[NOW + 1 :]
        before.append(err[-1])
        after.append(err[-1] - expected[-1])
    left = np.sqrt(np.mean(np.square(after), axis=0) / np.mean(np.square(before), axis=0))
    np.testing.assert_array_less(left, [0.6, 0.5, 1.0])


def test_nothing_is_known_of_a_gap_without_end() -> None:
    given, seen = from_now(recorded()), from_now(driven(TIMES_S))
    left = slice(None, LAST - 1)
    (interval,) = unmeasured_intervals.find_intervals(given[left], TIMES_S[left])
    np.testing.assert_array_equal(interval.errors(given[left], seen[: NOW + 1], TIMES_S[left]), 0)


@pytest.mark.parametrize("turned", [np.array([0.0, 0.5, 0.0]), np.array([0.1, 2.0, -0.1])])
def test_the_world_s_axes_do_not_matter(turned: FloatArray) -> None:
    world = se3.exp(np.concatenate([[1.0, 2.0, 3.0], turned]))
    assert unmeasured_intervals.find_intervals(world @ recorded(), TIMES_S) == [
        Interval(FIRST, LAST)
    ]


def test_kitti_s_recording_of_00_has_a_gap_that_images_bridge() -> None:
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
    assert unmeasured_intervals.find_intervals(given, times_s) == [
        Interval(5, 21)
    ]  # frames 346 to 362
    grey = np.stack([pinhole.grey(frame) for frame in clip.full.frames[:24]])
    seen, witness = (
        registered(grey[:count], clip.full.intrinsics, given[:count], NOW).world_from_cam
        for count in (NOW + 1, 24)
    )
    given, seen, witness = (se3.inverse(given[NOW]) @ poses for poses in (given, seen, witness))
    err = np.degrees(se3.turn(given[22], witness[22]))
    left = err - np.degrees(Interval(5, 21).errors(given, seen, times_s)[22 - NOW - 1])
    assert np.linalg.norm(err) > 1
    assert np.linalg.norm(left) < 0.3
