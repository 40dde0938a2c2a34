"""Monocular odometry on a corridor whose poses are known: clips, streams, and what it asks for."""

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from geovp_classic import interfaces, registry
from geovp_classic.errors import BadData, Incompatible, UnknownComponent
from geovp_classic.geometry import se3
from geovp_classic.odometry.ground_plane_scale import GroundPlane
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.odometry.speed_prior import SpeedPrior
from geovp_classic.odometry.unit_scale import UnitSpeed
from geovp_classic.types import (
    ByteArray,
    Context,
    ExtraView,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
)

Film = Callable[[FloatArray], tuple[ByteArray, FloatArray]]


def context(frames: ByteArray, camera: Intrinsics, height_m: float | None = 1.65) -> Context:
    return Context(frames, 0.1 * np.arange(len(frames) + 1), camera, camera_height_m=height_m)


def steps(world_from_cam: FloatArray) -> FloatArray:
    return se3.inverse(world_from_cam[:-1]) @ world_from_cam[1:]


def step_errors(found: Trajectory, truth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation in degrees [T - 1] and translation in units of the truth [T - 1]."""
    off = se3.inverse(steps(truth)) @ steps(found.world_from_cam)
    return np.degrees(se3.rotation_angle_rad(off)), np.linalg.norm(off[:, :3, 3], axis=1)


@pytest.fixture(scope="module")
def tracked_straight(
    straight: tuple[ByteArray, FloatArray], camera: Intrinsics
) -> tuple[Trajectory, FloatArray]:
    return Monocular().track(context(straight[0], camera))


def test_a_clip_comes_back_in_metres(
    tracked_straight: tuple[Trajectory, FloatArray], straight: tuple[ByteArray, FloatArray]
) -> None:
    trajectory, tracked = tracked_straight
    rotation_deg, translation = step_errors(trajectory, straight[1])
    assert trajectory.is_metric
    assert trajectory.scale_uncertainty is not None
    assert 0 < trajectory.scale_uncertainty < 0.1
    assert tracked.all()
    assert np.median(rotation_deg) < 0.05
    assert np.median(translation) < 0.02  # of 0.5 m


def test_the_same_seed_gives_the_same_bytes(
    tracked_straight: tuple[Trajectory, FloatArray],
    straight: tuple[ByteArray, FloatArray],
    camera: Intrinsics,
) -> None:
    again, _ = Monocular().track(context(straight[0], camera))
    np.testing.assert_array_equal(again.world_from_cam, tracked_straight[0].world_from_cam)


def test_without_metres_the_mean_step_is_one(
    straight: tuple[ByteArray, FloatArray], camera: Intrinsics
) -> None:
    trajectory, _ = Monocular(scale=UnitSpeed()).track(context(straight[0], camera, height_m=None))
    assert not trajectory.is_metric
    lengths = np.linalg.norm(np.diff(trajectory.world_from_cam[:, :3, 3], axis=0), axis=1)
    assert lengths.mean() == pytest.approx(1)
    np.testing.assert_allclose(lengths, 1, atol=0.05)


def test_a_hidden_road_leaves_metres_with_a_stated_spread(
    straight: tuple[ByteArray, FloatArray], camera: Intrinsics
) -> None:
    frames = straight[0].copy()
    frames[:, camera.height_px // 2 + 8 :] = (
        90  # a bonnet, or a car right ahead, from frame to frame the same
    )
    trajectory, _ = Monocular().track(context(frames, camera))
    assert trajectory.is_metric
    assert trajectory.scale_uncertainty == SpeedPrior().spread
    lengths = np.linalg.norm(np.diff(trajectory.world_from_cam[:, :3, 3], axis=0), axis=1)
    assert lengths.sum() / 0.9 == pytest.approx(
        SpeedPrior().median_m_s
    )  # the corridor's 5 m/s are within two spreads
    alone, _ = Monocular(scale=GroundPlane(prior=None)).track(context(frames, camera))
    assert (alone.is_metric, alone.scale_uncertainty) == (False, None)


@pytest.mark.parametrize("step_m", [0.1, 0.25, 2.7])
def test_slow_and_fast_cameras_come_back_in_metres(
    drive: Film, camera: Intrinsics, step_m: float
) -> None:
    """A car in a yard, one at 30 images a second, and one on a motorway, at ten."""
    frames, poses = drive(np.tile([0, 0, step_m, 0, np.radians(0.3), 0], (9, 1)))
    trajectory, _ = Monocular().track(context(frames, camera))
    assert trajectory.scale_uncertainty is not None
    assert trajectory.scale_uncertainty < 0.1
    lengths = np.linalg.norm(steps(trajectory.world_from_cam)[:, :3, 3], axis=1)
    assert lengths.sum() == pytest.approx(
        np.linalg.norm(steps(poses)[:, :3, 3], axis=1).sum(), rel=0.06
    )


@pytest.mark.parametrize("pitch_deg", [-5.0, 8.0])
def test_a_pitched_camera_comes_back_in_metres(
    drive: Film, camera: Intrinsics, pitch_deg: float
) -> None:
    """It travels along the road, so its direction of travel says where the road is."""
    pitch_rad = np.radians(pitch_deg)
    ahead = [0, 0.5 * np.sin(pitch_rad), 0.5 * np.cos(pitch_rad), 0, 0, 0]
    frames, _ = drive(np.array([[0, 0, 0, pitch_rad, 0, 0], *[ahead] * 9]))
    trajectory, _ = Monocular().track(context(frames[1:], camera))
    assert trajectory.scale_uncertainty is not None
    assert trajectory.scale_uncertainty < 0.1
    lengths = np.linalg.norm(steps(trajectory.world_from_cam)[:, :3, 3], axis=1)
    assert lengths.sum() == pytest.approx(4.5, rel=0.06)


def test_a_turn_with_sideways_motion(drive: Film, camera: Intrinsics) -> None:
    frames, poses = drive(np.tile([0.1, 0, 0.4, 0, np.radians(1.5), 0], (9, 1)))
    trajectory, tracked = Monocular().track(context(frames, camera))
    rotation_deg, translation = step_errors(trajectory, poses)
    assert tracked.all()
    assert np.median(rotation_deg) < 0.06
    assert np.median(translation) < 0.04


def test_standing_still_is_standing_still(
    straight: tuple[ByteArray, FloatArray], camera: Intrinsics
) -> None:
    trajectory, tracked = Monocular().track(context(np.repeat(straight[0][:1], 6, axis=0), camera))
    np.testing.assert_array_equal(trajectory.world_from_cam, np.tile(np.eye(4), (6, 1, 1)))
    assert tracked.all()
    assert trajectory.is_metric  # nothing moved, in any unit
    assert trajectory.scale_uncertainty is None


def test_turning_on_the_spot_moves_nowhere(drive: Film, camera: Intrinsics) -> None:
    frames, poses = drive(np.tile([0, 0, 0, 0, np.radians(1.0), 0], (7, 1)))
    trajectory, tracked = Monocular().track(context(frames, camera))
    assert tracked.all()
    assert (
        np.degrees(se3.rotation_angle_rad(se3.inverse(poses) @ trajectory.world_from_cam)).max()
        < 0.1
    )
    np.testing.assert_array_equal(trajectory.world_from_cam[:, :3, 3], 0)


def test_a_slow_start_is_told_afterwards(drive: Film, camera: Intrinsics) -> None:
    speeds = np.array([0.0, 0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5])
    frames, _ = drive(np.stack([[0, 0, speed, 0, 0, 0] for speed in speeds]))
    trajectory, tracked = Monocular().track(context(frames, camera))
    assert tracked.all()
    np.testing.assert_allclose(steps(trajectory.world_from_cam)[:, 2, 3], speeds, atol=0.03)


@pytest.mark.parametrize("count", [1, 2])
def test_the_shortest_clips(
    straight: tuple[ByteArray, FloatArray], camera: Intrinsics, count: int
) -> None:
    trajectory, tracked = Monocular().track(context(straight[0][:count], camera))
    assert (len(trajectory), tracked.all()) == (count, True)


def test_wide_frames_are_used_when_asked_for(
    straight: tuple[ByteArray, FloatArray], camera: Intrinsics
) -> None:
    frames, poses = straight
    crop = frames[:, 48:144, 64:192]
    odometry = Monocular(frames="full")
    assert odometry.needs == PrivilegedInput.CAMERA_HEIGHT | PrivilegedInput.FULL_FRAMES
    small = context(
        np.zeros_like(crop), camera.cropped(64, 48, 128, 96)
    )  # the crop itself shows nothing
    with pytest.raises(Incompatible, match="full"):
        odometry.track(small)
    wide = Context(
        small.frames,
        small.times_s,
        small.intrinsics,
        camera_height_m=1.65,
        full=ExtraView(frames, camera, np.eye(4)),
    )
    trajectory, _ = odometry.track(wide)
    assert np.median(step_errors(trajectory, poses)[1]) < 0.02


def test_a_missing_height_is_incompatible(
    straight: tuple[ByteArray, FloatArray], camera: Intrinsics
) -> None:
    with pytest.raises(Incompatible, match="height"):
        Monocular().track(context(straight[0], camera, height_m=None))


def test_settings_that_cannot_work_are_bad_data() -> None:
    with pytest.raises(BadData, match="window"):
        Monocular(window=2)
    with pytest.raises(UnknownComponent, match="num_features"):  # a setting of earlier versions
        registry.build("odometries", {"name": "monocular", "features": "orb"})


def test_it_comes_by_name_and_goes_back() -> None:
    odometry = registry.build(
        "odometries", {"name": "monocular", "scale": {"name": "unit-speed"}, "num_features": 300}
    )
    assert isinstance(odometry, interfaces.Odometry)
    assert registry.build("odometries", registry.describe(odometry)) == odometry


@pytest.fixture(scope="module")
def long_drive(drive: Film) -> tuple[ByteArray, FloatArray]:
    turns = np.radians(0.6) * np.sin(np.arange(39) / 6)
    return drive(np.stack([[0, 0, 0.5, 0, turn, 0] for turn in turns]))


def test_a_sequence_is_tracked_as_a_stream(
    long_drive: tuple[ByteArray, FloatArray], camera: Intrinsics
) -> None:
    frames, poses = long_drive
    times_s = 0.1 * np.arange(len(frames))
    trajectory, tracked = Monocular(window=5).track_sequence(iter(frames), times_s, camera, 1.65)
    assert len(trajectory) == len(frames)
    assert tracked.all()
    rotation_deg, translation = step_errors(trajectory, poses)
    assert np.median(rotation_deg) < 0.1
    assert np.median(translation) < 0.03


def test_a_stream_says_at_once_where_it_is_and_keeps_little(
    long_drive: tuple[ByteArray, FloatArray], camera: Intrinsics
) -> None:
    frames, poses = long_drive
    stream = Monocular(window=5).stream(camera, 1.65)
    found, kept = [], []
    for i, frame in enumerate(frames):
        step = stream.push(frame, 0.1 * i)
        found.append(step.world_from_cam)
        stream.take_final()
        kept.append(len(stream._tracker.map.points))
    assert step.tracked
    assert step.confidence > 0.5
    assert (
        step_errors(Trajectory(np.stack(found), 0.1 * np.arange(len(found)), True), poses)[0].mean()
        < 0.15
    )
    assert max(kept[20:]) < 1.5 * max(kept[5:20])


def test_standing_for_long_keeps_nothing(
    straight: tuple[ByteArray, FloatArray], camera: Intrinsics
) -> None:
    stream = Monocular().stream(camera, 1.65)
    frame, settled = straight[0][0], 0
    for i in range(150):
        stream.push(frame, 0.1 * i)
        settled += len(stream.take_final()[0])
        assert len(stream._tracker._poses._pending) <= 60
    settled += len(stream.take_final(all_of_them=True)[0])
    assert settled == 150


@pytest.mark.parametrize(("backward_error", "turns"), [(0.5, False), (2.0, True)])
def test_a_path_to_the_side_is_tracked_backwards_too(
    backward_error: float, turns: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the two paths the one whose map has the smaller reprojection error is taken, from its
    first frame on.
    """
    straight = se3.exp(np.arange(10.0)[:, None] * [0, 0, 0.5, 0, 0, 0])
    sideways = se3.exp(np.arange(10.0)[:, None] * [-0.8, 0, 0.1, 0, 0.14, 0])
    asked = []

    def path(
        self: Monocular, greys: list[ByteArray], times_s: FloatArray, camera: Intrinsics
    ) -> Any:
        asked.append((greys[0].mean(), times_s[0]))
        error, poses = (1.0, sideways) if len(asked) == 1 else (backward_error, straight[::-1])
        return poses, np.ones(10, bool), error, 0.0

    monkeypatch.setattr(Monocular, "_path", path)
    brightness = 20 * np.arange(1, 11, dtype=np.uint8)[:, None, None, None]
    frames = np.random.default_rng(0).integers(0, 20, (10, 64, 64, 3), dtype=np.uint8) + brightness
    trajectory, _ = Monocular(scale=UnitSpeed()).track(
        context(frames, Intrinsics(60.0, 60.0, 31.5, 31.5, 64, 64))
    )
    assert asked[0][0] < asked[1][0]  # the last frame, which is brighter, comes first
    assert asked[1][1] == pytest.approx(-0.9)
    unit = np.linalg.norm(trajectory.world_from_cam[1, :3, 3])
    step = (sideways if turns else straight)[1]
    np.testing.assert_allclose(
        trajectory.world_from_cam[1, :3, 3] / unit, step[:3, 3] / np.linalg.norm(step[:3, 3])
    )
    np.testing.assert_allclose(trajectory.world_from_cam[0], np.eye(4), atol=1e-12)


@pytest.mark.parametrize(("lost", "at"), [((1, 2, 3), 0), ((1, 2, 3, 4, 5, 6), 6)])
def test_what_was_not_tracked_moved_on_evenly(
    lost: tuple[int, ...], at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the first motion is known, the tracker leaves lost images where the one before them
    was.
    """
    true = se3.exp(np.arange(10.0)[:, None] * [0, 0, 0.5, 0, 0.05, 0])
    poses, tracked = true.copy(), np.ones(10, bool)
    poses[list(lost)], tracked[list(lost)] = true[0], False
    poses[max(lost) + 1 :] = se3.inverse(true[at]) @ true[max(lost) + 1 :]  # started anew there
    monkeypatch.setattr(Monocular, "_path", lambda *_: (poses.copy(), tracked, 1.0, 0.0))
    frames = np.random.default_rng(0).integers(0, 255, (10, 64, 64, 3), dtype=np.uint8)
    frames = (
        np.broadcast_to(frames[:1], frames.shape) // 2
        + np.arange(10, dtype=np.uint8)[:, None, None, None]
    )
    trajectory, marks = Monocular(scale=UnitSpeed()).track(
        context(frames, Intrinsics(60.0, 60.0, 31.5, 31.5, 64, 64))
    )
    tracked[0] = at == 0
    np.testing.assert_array_equal(marks, tracked)
    np.testing.assert_allclose(steps(trajectory.world_from_cam)[:, 2, 3], 1, atol=0.01)
    np.testing.assert_allclose(
        se3.rotation_angle_rad(steps(trajectory.world_from_cam)), 0.05, atol=1e-6
    )


def test_a_real_turn_of_which_little_is_seen() -> None:
    """Letterboxed, the turn's first frames also fit 8 degrees a frame with a step to the side."""
    root = os.environ.get("GEOVP_TEST_DATA")
    if root is None:
        pytest.skip("GEOVP_TEST_DATA is not set: needs kitti/sequences/03")
    spec = {
        "name": "kitti",
        "root": f"{root}/kitti",
        "sequences": ["03[100:111)"],
        "num_frames": 11,
        "stride": 11,
    }
    clip = next(iter(registry.build("datasets", spec)))
    given, _ = clip.split(10, PrivilegedInput.CAMERA_HEIGHT)
    top, height = 32, 192
    cut = replace(
        given,
        frames=given.frames[:, top : top + height],
        intrinsics=given.intrinsics.cropped(0, top, 256, height),
    )
    trajectory, _ = Monocular().track(cut)
    assert step_errors(trajectory, clip.trajectory.world_from_cam[:10])[0].max() < 0.2


def test_a_real_street_in_metres() -> None:
    root = os.environ.get("GEOVP_TEST_DATA")
    if root is None:
        pytest.skip("GEOVP_TEST_DATA is not set: needs kitti/sequences/03")
    spec = {
        "name": "kitti",
        "root": f"{root}/kitti",
        "sequences": ["03[0:60)"],
        "num_frames": 11,
        "stride": 24,
    }
    rotations_deg, lengths = [], []
    for clip in registry.build("datasets", spec):
        given, _ = clip.split(10, PrivilegedInput.CAMERA_HEIGHT)
        trajectory, tracked = Monocular().track(given)
        assert tracked.all()
        rotations_deg.append(step_errors(trajectory, clip.trajectory.world_from_cam[:10])[0])
        found = np.linalg.norm(steps(trajectory.world_from_cam)[:, :3, 3], axis=1).sum()
        lengths.append(
            found
            / np.linalg.norm(steps(clip.trajectory.world_from_cam[:10])[:, :3, 3], axis=1).sum()
        )
    assert np.median(rotations_deg) < 0.05
    np.testing.assert_allclose(lengths, 1, atol=0.1)
