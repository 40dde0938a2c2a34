"""Monocular odometry on a corridor whose poses are known: clips, sequences and settings."""

import os
from dataclasses import replace

import numpy as np
import pytest

from geovp_classic.data.layouts.kitti import Kitti
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.odometry import monocular
from geovp_classic.odometry.ground_plane_scale import GroundPlane
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.odometry.tracking import Image, TrackedPoses, TrackerSettings
from geovp_classic.odometry.unit_scale import UnitSpeed
from geovp_classic.odometry.windowed_map import KeyframePolicy
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    ExtraView,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
)
from geovp_classic.types.speed_prior import SpeedPrior
from tests.geovp_classic.odometry.corridor import CAMERA, STRAIGHT, drive


def context(
    frames: ByteArray, camera: Intrinsics = CAMERA, height_m: float | None = 1.65
) -> Context:
    return Context(frames, 0.1 * np.arange(len(frames) + 1), camera, camera_height_m=height_m)


def steps(world_from_cam: FloatArray) -> FloatArray:
    return se3.inverse(world_from_cam[:-1]) @ world_from_cam[1:]


def step_errors(found: Trajectory, truth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation in degrees [T - 1] and translation in units of the truth [T - 1]."""
    off = se3.inverse(steps(truth)) @ steps(found.world_from_cam)
    return np.degrees(se3.rotation_angle_rad(off)), np.linalg.norm(off[:, :3, 3], axis=1)


def test_a_clip_comes_back_in_metres() -> None:
    trajectory, tracked = Monocular().track(context(STRAIGHT[0]))
    rotation_deg, translation = step_errors(trajectory, STRAIGHT[1])
    assert trajectory.is_metric
    assert 0 < trajectory.scale_uncertainty < 0.1
    assert tracked.all()
    assert np.median(rotation_deg) < 0.05
    assert np.median(translation) < 0.02  # of 0.5 m


def test_a_start_behind_a_car_that_starts_is_no_turn() -> None:
    """In one second the camera moves .4 m, and a turn may cancel a motion past far points."""
    clip = Synthetic(num_clips=6, num_frames=11)[5]  # accelerates
    trajectory, _ = Monocular(UnitSpeed()).track(clip.split(10, PrivilegedInput.NONE)[0])
    found, true = (
        se3.inverse(poses[0]) @ poses[9]
        for poses in (trajectory.world_from_cam, clip.trajectory.world_from_cam)
    )
    # 8.5 degrees if parallax is counted from the turn that was found with it
    assert np.degrees(se3.rotation_angle_rad(se3.inverse(true) @ found)) < 0.1


def test_without_metres_the_mean_step_is_one() -> None:
    trajectory, _ = Monocular(UnitSpeed()).track(context(STRAIGHT[0], height_m=None))
    assert not trajectory.is_metric
    np.testing.assert_allclose(se3.step_lengths(trajectory.world_from_cam), 1, atol=0.05)


def test_a_hidden_road_leaves_metres_with_a_stated_spread() -> None:
    frames = STRAIGHT[0].copy()
    # a bonnet, or a car right ahead, from frame to frame the same
    frames[:, CAMERA.height_px // 2 + 8 :] = 90
    trajectory, _ = Monocular().track(context(frames))
    assert trajectory.is_metric
    assert trajectory.scale_uncertainty == SpeedPrior().spread
    lengths = se3.step_lengths(trajectory.world_from_cam)
    assert lengths.sum() / 0.9 == pytest.approx(
        SpeedPrior().median_m_s
    )  # the corridor's 5 m/s are within two spreads
    alone, _ = Monocular(GroundPlane(prior=None)).track(context(frames))
    assert (alone.is_metric, alone.scale_uncertainty) == (False, None)


@pytest.mark.parametrize("step_m", [0.1, 0.25, 2.7])
def test_slow_and_fast_cameras_come_back_in_metres(step_m: float) -> None:
    """A car in a yard, one at 30 images a second, and one on a motorway, at ten."""
    frames, poses = drive(np.tile([0, 0, step_m, 0, np.radians(0.3), 0], (9, 1)))
    trajectory, _ = Monocular().track(context(frames))
    assert trajectory.scale_uncertainty < 0.1
    lengths = se3.step_lengths(trajectory.world_from_cam)
    assert lengths.sum() == pytest.approx(se3.step_lengths(poses).sum(), rel=0.06)


@pytest.mark.parametrize("pitch_deg", [-5.0, 8.0])
def test_a_pitched_camera_comes_back_in_metres(pitch_deg: float) -> None:
    """It travels along the road, so its direction of travel says where the road is."""
    pitch_rad = np.radians(pitch_deg)
    ahead = [0, 0.5 * np.sin(pitch_rad), 0.5 * np.cos(pitch_rad), 0, 0, 0]
    frames, _ = drive(np.array([[0, 0, 0, pitch_rad, 0, 0], *[ahead] * 9]))
    trajectory, _ = Monocular().track(context(frames[1:]))
    assert trajectory.scale_uncertainty < 0.1
    assert se3.step_lengths(trajectory.world_from_cam).sum() == pytest.approx(4.5, rel=0.06)


def test_standing_still_is_standing_still() -> None:
    trajectory, tracked = Monocular().track(context(np.repeat(STRAIGHT[0][:1], 6, axis=0)))
    np.testing.assert_array_equal(trajectory.world_from_cam, np.tile(np.eye(4), (6, 1, 1)))
    assert tracked.all()
    assert trajectory.is_metric  # nothing moved, in any unit
    assert trajectory.scale_uncertainty is None


def test_turning_on_the_spot_moves_nowhere() -> None:
    frames, poses = drive(np.tile([0, 0, 0, 0, np.radians(1.0), 0], (7, 1)))
    trajectory, tracked = Monocular().track(context(frames))
    assert tracked.all()
    assert (
        np.degrees(se3.rotation_angle_rad(se3.inverse(poses) @ trajectory.world_from_cam)).max()
        < 0.1
    )
    np.testing.assert_array_equal(trajectory.world_from_cam[:, :3, 3], 0)


def test_a_slow_start_is_told_afterwards() -> None:
    speeds = np.array([0.0, 0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5])
    frames, _ = drive(np.stack([[0, 0, speed, 0, 0, 0] for speed in speeds]))
    trajectory, tracked = Monocular().track(context(frames))
    assert tracked.all()
    np.testing.assert_allclose(steps(trajectory.world_from_cam)[:, 2, 3], speeds, atol=0.03)


@pytest.mark.parametrize("count", [1, 2])
def test_the_shortest_clips(count: int) -> None:
    trajectory, tracked = Monocular().track(context(STRAIGHT[0][:count]))
    assert (len(trajectory), tracked.all()) == (count, True)


def test_uncropped_frames_are_used_if_asked_for() -> None:
    frames, poses = STRAIGHT
    crop = frames[:, 48:144, 64:192]
    odometry = Monocular(frames="full")
    assert odometry.needs == PrivilegedInput.CAMERA_HEIGHT | PrivilegedInput.FULL_FRAMES
    small = context(
        np.zeros_like(crop), CAMERA.cropped(64, 48, 128, 96)
    )  # the crop itself is black
    with pytest.raises(Incompatible, match="uncropped"):
        odometry.track(small)
    wide = replace(small, full=ExtraView(frames, CAMERA, np.eye(4)))
    trajectory, _ = odometry.track(wide)
    assert np.median(step_errors(trajectory, poses)[1]) < 0.02


@pytest.mark.parametrize("hood_px", [0, 80])
def test_a_sequence_is_tracked_in_a_window(hood_px: int) -> None:
    turns = np.radians(0.6) * np.sin(np.arange(39) / 6)
    frames, poses = drive(np.stack([[0, 0, 0.5, 0, turn, 0] for turn in turns]))
    poses[:, :3, 3] /= 0.5  # in mean steps
    rows = frames[:, CAMERA.height_px - hood_px :]
    rows[:] = np.random.default_rng(0).integers(0, 255, rows.shape[1:])
    times_s = 0.1 * np.arange(len(frames))
    odometry = Monocular(UnitSpeed(), tracking=TrackerSettings(keyframes=KeyframePolicy(window=5)))
    trajectory, tracked = odometry.track_sequence(iter(frames), times_s, CAMERA)
    assert tracked.all()
    rotation_deg, translation = step_errors(trajectory, poses)
    assert np.median(rotation_deg) < 0.1
    assert np.median(translation) < 0.03


def test_a_drive_whose_scale_remembers_few_pairs() -> None:
    """Images before the remembered pairs have the unit of the first of them."""
    frames = STRAIGHT[0]
    odometry = Monocular(GroundPlane(max_pairs=3))
    times_s = 0.1 * np.arange(len(frames))
    trajectory, _ = odometry.track_sequence(frames, times_s, CAMERA, 1.65)
    assert trajectory.is_metric
    np.testing.assert_allclose(se3.step_lengths(trajectory.world_from_cam), 0.5, rtol=0.06)


class ScriptedTracker:
    """A tracker of a given path."""

    def __init__(self, path: TrackedPoses) -> None:
        self.path = path

    def push(self, image: Image) -> None:
        """Ignore the image."""

    def forget(self, num_images: int) -> None:
        """Remember all."""

    def adjust(self) -> None:
        """Change nothing."""

    def poses(self) -> TrackedPoses:
        """Return the path."""
        return self.path


def scripted(monkeypatch: pytest.MonkeyPatch, path: TrackedPoses) -> tuple[Trajectory, BoolArray]:
    """Return the result of an odometry that tracks this path of ten random images."""
    monkeypatch.setattr(monocular, "Tracker", lambda *_: ScriptedTracker(path))
    brightness = 20 * np.arange(1, 11, dtype=np.uint8)[:, None, None, None]
    frames = np.random.default_rng(0).integers(0, 20, (10, 64, 64, 3), dtype=np.uint8) + brightness
    odometry = Monocular(UnitSpeed())
    return odometry.track(context(frames, Intrinsics(60.0, 60.0, 31.5, 31.5, 64, 64)))


@pytest.mark.parametrize(("lost", "restart"), [((1, 2, 3), 0), ((1, 2, 3, 4, 5, 6), 6)])
def test_lost_images_are_bridged_at_constant_velocity(
    monkeypatch: pytest.MonkeyPatch, lost: tuple[int, ...], restart: int
) -> None:
    """Before any motion is known, the tracker leaves lost images where the one before was."""
    truth = se3.exp(np.arange(10.0)[:, None] * [0, 0, 0.5, 0, 0.05, 0])
    poses = truth.copy()
    tracked = np.ones(10, dtype=bool)
    poses[list(lost)] = truth[0]
    tracked[list(lost)] = False
    poses[max(lost) + 1 :] = se3.inverse(truth[restart]) @ truth[max(lost) + 1 :]
    segments = np.zeros(10, dtype=int)
    is_localised = tracked.copy()
    if restart:
        segments[restart:] = 1
        is_localised[restart] = True
    path = TrackedPoses(poses, tracked.copy(), is_localised, segments)
    trajectory, marks = scripted(monkeypatch, path)
    tracked[0] = restart == 0
    np.testing.assert_array_equal(marks, tracked)
    motion = steps(trajectory.world_from_cam)
    np.testing.assert_allclose(motion[:, 2, 3], 1, atol=0.01)
    np.testing.assert_allclose(se3.rotation_angle_rad(motion), 0.05, atol=1e-6)


def test_segments_with_different_units_are_not_mixed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The map is replaced at the fifth of ten images: its unit is three times shorter."""
    poses = np.tile(np.eye(4), (10, 1, 1))
    poses[:, 2, 3] = np.cumsum([0, 1, 1, 1, 3, 3, 3, 3, 3, 3])
    segments = np.repeat([0, 1], [4, 6])
    everywhere = np.ones(10, dtype=bool)
    path = TrackedPoses(poses, everywhere, everywhere, segments)
    trajectory, tracked = scripted(monkeypatch, path)
    np.testing.assert_allclose(se3.step_lengths(trajectory.world_from_cam), 1.0)
    np.testing.assert_array_equal(tracked, segments == 1)


def street(frames: str, stride: int) -> Kitti:
    """Return clips of eleven real frames."""
    root = os.environ.get("GEOVP_TEST_DATA")
    if root is None:
        pytest.skip("GEOVP_TEST_DATA is not set: needs kitti/sequences/03")
    return Kitti(f"{root}/kitti", num_frames=11, stride=stride, sequences=(frames,))


def test_a_real_turn_of_which_little_is_seen() -> None:
    """Letterboxed, the turn's first frames also fit 8 degrees a frame with a step to the side."""
    clip = street("03[100:111)", 11)[0]
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
    rotations_deg, lengths = [], []
    for clip in street("03[0:60)", 24):
        given, _ = clip.split(10, PrivilegedInput.CAMERA_HEIGHT)
        trajectory, tracked = Monocular().track(given)
        assert tracked.all()
        rotations_deg.append(step_errors(trajectory, clip.trajectory.world_from_cam[:10])[0])
        found, truth = (
            se3.step_lengths(poses).sum()
            for poses in (trajectory.world_from_cam, clip.trajectory.world_from_cam[:10])
        )
        lengths.append(found / truth)
    assert np.median(rotations_deg) < 0.05
    np.testing.assert_allclose(lengths, 1, atol=0.1)
