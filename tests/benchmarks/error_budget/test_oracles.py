"""Stages from ground truth, on toy frames and trajectories with results worked out by hand."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.error_budget.oracles import (
    POSE_STAGES,
    OracleClip,
    mixed_poses,
    with_true_depth,
)
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.depth.given import Given
from geovp_classic.forecasting.constant import ConstantVelocity
from geovp_classic.geometry import planar, se3
from geovp_classic.odometry.recorded_past import RecordedPast
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.planar import Planar
from geovp_classic.pose_sources.refined import Refined
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.renderers.ground_far_plane import GroundFarPlane
from geovp_classic.types import (
    BoolArray,
    Clip,
    Context,
    FloatArray,
    Intrinsics,
    Motion,
    PrivilegedInput,
    Trajectory,
    Views,
)

YAW, PITCH, ROLL = np.deg2rad([10.0, 2.0, 3.0])


def straight(step_m: float, direction: tuple[float, float, float]) -> FloatArray:
    """Return four steps last_from_cam [4, 4, 4] without a turn."""
    return se3.compose(np.eye(3), step_m * np.arange(1, 5)[:, None] * np.array(direction))


def turned_truth() -> FloatArray:
    """Return steps of 2 m along (0.6, 0.8), 0.2 m higher, turned by 10, 2 and 3 degrees."""
    yaw = np.array([[np.cos(YAW), 0, np.sin(YAW)], [0, 1, 0], [-np.sin(YAW), 0, np.cos(YAW)]])
    truth = straight(2.0, (0.6, 0.0, 0.8))
    truth[:, 1, 3] = -0.2
    truth[:, :3, :3] = yaw @ planar.level_vehicle_from_cam(PITCH, ROLL)[:3, :3]
    return truth


FORECAST, REAL = straight(1.0, (0.0, 0.0, 1.0)), turned_truth()


def test_all_pose_stages_give_the_truth_and_none_the_forecast() -> None:
    everything = mixed_poses(FORECAST, REAL, frozenset(POSE_STAGES))
    np.testing.assert_allclose(everything, REAL, atol=1e-12)
    np.testing.assert_allclose(mixed_poses(FORECAST, REAL, frozenset()), FORECAST, atol=1e-12)


@pytest.mark.parametrize(
    ("stage", "axis", "direction"),
    [
        ("yaw", 2, (np.sin(YAW), 0, np.cos(YAW))),  # the view, to the right
        ("pitch", 2, (0, -np.sin(PITCH), np.cos(PITCH))),  # the view, upwards
        ("roll", 0, (np.cos(ROLL), np.sin(ROLL), 0)),  # the image's right, downwards
    ],
)
def test_an_angle_turns_the_camera_in_place(
    stage: str, axis: int, direction: tuple[float, ...]
) -> None:
    mixed = mixed_poses(FORECAST, REAL, frozenset({stage}))
    np.testing.assert_allclose(mixed[:, :3, axis], np.tile(direction, (4, 1)), atol=1e-12)
    np.testing.assert_array_equal(mixed[:, :3, 3], FORECAST[:, :3, 3])


@dataclass(frozen=True)
class HalfScale:
    """The recorded positions at half their size."""

    needs = PrivilegedInput.PAST_POSES

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        assert context.future is None  # which it has not declared
        poses = context.past.world_from_cam.copy()
        poses[:, :3, 3] /= 2
        return Trajectory(poses, context.past.times_s, True), np.ones(len(poses), dtype=bool)


@dataclass(frozen=True)
class HalfCovered:
    """Grey 100, inpainted with 0 in the right half, and everywhere from 10 units ahead on."""

    needs = PrivilegedInput.NONE

    def reconstruct(self, context: Context, past: Trajectory) -> "HalfCovered":
        return self

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        shape = (len(times_s), intrinsics.height_px, intrinsics.width_px)
        covered = np.zeros(shape, dtype=bool)
        covered[world_from_cam[:, 2, 3] < 10, :, : shape[2] // 2] = True
        frames = np.where(covered[..., None], 100, 0) * np.ones(3, np.uint8)
        return Views(frames.astype(np.uint8), covered, np.ones(shape, np.float32))


def oracle_clip(source: Any, grey: int, z: Any, moving: BoolArray | None = None) -> OracleClip:
    """Return five observed frames, then future ones, of one grey value along z."""
    times_s = 0.1 * np.arange(len(z))
    poses = se3.compose(np.eye(3), np.outer(z, [0.0, 0.0, 1.0]))
    frames = np.full((len(z), 64, 64, 3), grey, np.uint8)
    camera = Intrinsics(90.0, 90.0, 31.5, 31.5, 64, 64)
    trajectory = Trajectory(poses, times_s, True)
    clip = Clip("toy", frames, times_s, camera, trajectory, moving=moving)
    return OracleClip(GeometricPredictor(source, HalfCovered()), clip, 5, [0, 4])


def ahead(motion: Motion) -> FloatArray:
    """Return z of past and future cameras relative to the last observed one."""
    poses = np.concatenate([motion.past.world_from_cam, motion.futures[0]])
    return np.asarray(poses[:, 2, 3] - motion.past.world_from_cam[-1, 2, 3])


SOURCE = Chained(HalfScale(), ConstantVelocity())
FASTER = [*range(5), 6, 8, 10, 12, 14]  # 1 m a step, then 2 m; black frames are not registered


@pytest.mark.parametrize("source", [SOURCE, Refined(SOURCE, ()), Planar(SOURCE)])
def test_the_true_past_gives_a_new_forecast_in_metres(source: Any) -> None:
    clip = oracle_clip(source, 0, FASTER)
    assert clip.metres_per_unit == pytest.approx(2.0)
    units = np.arange(-4, 6)
    np.testing.assert_allclose(ahead(clip.motion(frozenset())), 0.5 * units, atol=1e-9)
    np.testing.assert_allclose(ahead(clip.motion(frozenset({"past"}))), units, atol=1e-9)


def test_true_positions_are_in_the_unit_of_the_past() -> None:
    clip = oracle_clip(SOURCE, 0, FASTER)
    fast = clip.motion(frozenset({"along"}))  # 2 m a step are 1 unit
    np.testing.assert_allclose(ahead(fast)[5:], [1, 2, 3, 4, 5], atol=1e-9)
    everything = clip.motion(frozenset({"past", *POSE_STAGES}))
    np.testing.assert_allclose(ahead(everything), np.subtract(FASTER, 4), atol=1e-9)


RECORDED = Chained(RecordedPast(), ConstantVelocity())


def test_holes_and_dynamic_objects_are_copied_from_the_real_frame() -> None:
    """The left half of a view is covered; something moves in the upper rows of the last frame."""
    moving = np.zeros((10, 64, 64), dtype=bool)
    moving[9, :10] = True
    clip = oracle_clip(RECORDED, 150, range(10), moving)
    filled, real = clip.frames(frozenset({"holes"}))
    assert filled.shape == real.shape == (2, 64, 64, 3)
    assert (filled[:, :, :32] == 100).all()
    assert (filled[:, :, 32:] == 150).all()
    moved, _ = clip.frames(frozenset({"dynamic objects"}))
    assert (moved[1, :10] == 150).all()
    assert (moved[0, :, :32] == 100).all()
    assert (moved[1, 10:, :32] == 100).all()


def test_true_depth_is_the_recorded_one_of_the_crop() -> None:
    clip = Synthetic(num_clips=1, num_frames=12, size_px=(96, 96))[0]
    replaced = with_true_depth(DepthFusion(), clip)
    assert isinstance(replaced, DepthFusion)
    assert replaced.depth == Given()
    assert with_true_depth(GroundFarPlane(), clip) is None
    assert with_true_depth(DepthFusion(frames="full"), clip) is None
    without = Clip(clip.name, clip.frames, clip.times_s, clip.intrinsics, clip.trajectory)
    assert with_true_depth(DepthFusion(), without) is None
