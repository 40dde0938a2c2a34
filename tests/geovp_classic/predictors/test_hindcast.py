"""Hindcasting: scenes that do not predict the observed frames are replaced."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from geovp_classic.errors import BadData
from geovp_classic.forecasting.constant import ConstantVelocity
from geovp_classic.geometry import pinhole
from geovp_classic.observation import Observer
from geovp_classic.observation.camera_fixed import CameraFixedDetection
from geovp_classic.odometry.recorded_past import RecordedPast
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.commanded import Commanded
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.predictors.flow_extrapolation import FlowExtrapolation
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.predictors.hindcast import Hindcast, HindcastVerdict, ShownScene
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    Context,
    FloatArray,
    Intrinsics,
    Motion,
    Prediction,
    PrivilegedInput,
    ShownBy,
    Trajectory,
    Views,
)
from tests.geovp_classic.rendering.wall import CAMERA, at, wall

NUM_PAST, NUM_FUTURE = 6, 2
HINDCAST = Hindcast()


def clip(step: float = 0.6) -> Clip:
    """Eight frames in front of a wall, `step` apart."""
    poses = at(*[(step * number, 0.1 * number) for number in range(NUM_PAST + NUM_FUTURE)])
    times_s = 0.1 * np.arange(len(poses))
    frames = np.stack([wall(pose)[0] for pose in poses])
    return Clip("wall", frames, times_s, CAMERA, Trajectory(poses, times_s, True))


@dataclass(frozen=True)
class Wall:
    """A renderer of the wall, seen from `offset` beside each pose and `gain` times as bright."""

    offset: float = 0.0
    gain: float = 1.0
    is_covered: bool = True

    needs = PrivilegedInput.NONE

    def reconstruct(self, context: Context, past: Trajectory) -> Wall:
        return self

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        poses = at((self.offset, 0.0)) @ world_from_cam
        images, depths = zip(*(wall(pose, camera=intrinsics) for pose in poses), strict=True)
        frames = (self.gain * np.stack(images)).astype(np.uint8)
        return Views(frames, np.full(frames.shape[:3], self.is_covered), np.stack(depths))


@dataclass(frozen=True)
class Brighter:
    """A predictor of the last frame, brighter."""

    needs = PrivilegedInput.NONE

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        bright = np.minimum(context.frames[-1].astype(int) + 50, 255).astype(np.uint8)
        return Prediction(np.tile(bright, (1, context.num_future, 1, 1, 1)))


def predict(
    of: Clip, renderer: Wall, hindcast: Hindcast | None = HINDCAST
) -> tuple[Prediction, Context]:
    context, _ = of.split(NUM_PAST, GroundTruth.needs)
    return GeometricPredictor(GroundTruth(), renderer, hindcast=hindcast).predict(context), context


def scene_of(renderer: Wall) -> tuple[ShownScene, Context]:
    context, _ = clip().split(NUM_PAST, GroundTruth.needs)
    predictor = GeometricPredictor(GroundTruth(), renderer, hindcast=HINDCAST)
    return predictor.reconstruct(predictor.observe(context), context.past), context


@pytest.mark.parametrize("renderer", [Wall(), Wall(offset=0.02)])
def test_a_scene_that_predicts_the_observed_frames_is_shown(renderer: Wall) -> None:
    prediction, context = predict(clip(), renderer)
    expected = renderer.view(context.future.world_from_cam, np.zeros(2), CAMERA).frames
    np.testing.assert_array_equal(prediction.frames[0], expected)
    assert (prediction.shown_by, prediction.is_trusted) == ("geometry", True)
    assert not prediction.copied.any()
    assert prediction.covered.all()


@pytest.mark.parametrize("renderer", [Wall(offset=2.4), Wall(gain=0.5)])
def test_the_motion_of_the_image_replaces_a_scene_that_does_not(renderer: Wall) -> None:
    prediction, context = predict(clip(), renderer)
    moved = FlowExtrapolation().predict(context)
    np.testing.assert_array_equal(prediction.frames, moved.frames)
    np.testing.assert_array_equal(prediction.covered, moved.covered)
    assert (prediction.shown_by, prediction.is_trusted) == ("image-motion", False)
    assert (prediction.confidence < predict(clip(), Wall())[0].confidence).all()


def test_the_last_frame_is_shown_where_nothing_predicts_better() -> None:
    still = replace(clip(), frames=np.repeat(clip().frames[:1], NUM_PAST + NUM_FUTURE, axis=0))
    copies = Hindcast(image_motion=Brighter())
    prediction, context = predict(still, Wall(), copies)
    assert (prediction.frames == context.frames[-1]).all()
    assert (prediction.shown_by, prediction.is_trusted) == ("last-frame", False)
    assert prediction.is_copy.tolist() == [[True, True]]
    assert not prediction.covered.any()


@pytest.mark.parametrize(("way", "is_copy"), [("last-frame", True), ("image-motion", False)])
@pytest.mark.parametrize(
    ("camera", "window"),
    [
        (CAMERA.resized(80, 60), np.s_[:]),
        (CAMERA.resized(320, 240), np.s_[:]),
        (CAMERA.cropped(8, 6, 48, 36), np.s_[6:42, 8:56]),
    ],
)
def test_a_replaced_scene_is_not_shown_in_any_camera(
    way: ShownBy, is_copy: bool, camera: Intrinsics, window: Any
) -> None:
    scene, context = scene_of(Wall(offset=2.4))
    times_s = context.times_s[NUM_PAST:]
    shown = replace(scene, verdict=HindcastVerdict(shown_by=way))
    views = shown.view(context.future.world_from_cam, times_s, camera)
    last = pinhole.resize(context.frames[-1][window], camera.size_px)
    assert (views.frames == [last, last]).all() == is_copy
    far = shown.scene.view(context.future.world_from_cam, times_s, camera)
    assert np.abs(views.frames.astype(int) - far.frames).mean() > 10


def test_image_motion_at_one_time_is_that_of_all_times() -> None:
    scene, context = scene_of(Wall())
    shown = replace(scene, verdict=HindcastVerdict(shown_by="image-motion"))
    poses, times_s = context.future.world_from_cam, context.times_s[NUM_PAST:]
    both = shown.view(poses, times_s, CAMERA).frames
    alone = shown.view(poses[1:], times_s[1:], CAMERA).frames
    np.testing.assert_array_equal(alone[0], both[1])


def test_in_half_the_size_the_mask_is_half_as_large() -> None:
    scene, context = scene_of(Wall())
    mask = np.zeros(context.frames.shape[1:3], bool)
    mask[-40:] = True
    copied = replace(scene, mask=mask).copied(context.future.world_from_cam, CAMERA.resized(32, 24))
    assert copied[:, -20:].all()
    assert not copied[:, :-20].any()


class Both(GroundTruth):
    """A pose source of two samples: the true future, and one beside it."""

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        motion = super().estimate(context)
        return replace(motion, futures=at((0.0, 0.0), (0.5, 0.0))[:, None] @ motion.futures[0])


def test_each_sample_is_rendered_from_its_own_future() -> None:
    context, _ = clip().split(NUM_PAST, GroundTruth.needs)
    frames = GeometricPredictor(Both(), Wall()).predict(context, num_samples=2).frames
    for offset, sample in zip((0.0, 0.5), frames, strict=True):
        expected = Wall(offset).view(context.future.world_from_cam, np.zeros(2), CAMERA)
        np.testing.assert_array_equal(sample, expected.frames)


def test_confidence_falls_with_the_error_and_the_step() -> None:
    right = predict(clip(), Wall())[0].confidence
    worse = predict(clip(), Wall(offset=0.02))[0].confidence
    # 6 tracked frames of the 7 and 8 up to each step
    assert right[0, 1] / right[0, 0] == pytest.approx((6 / 8) / (6 / 7))
    assert (worse > 0).all()
    assert (worse < 0.98 * right).all()


def test_from_the_last_pose_the_last_frame_is_shown() -> None:
    still = clip(step=0.0)
    poses = np.repeat(still.trajectory.world_from_cam[:1], NUM_PAST + NUM_FUTURE, axis=0)
    poses[-1, 0, 3] = 0.6  # it departs
    trajectory = replace(still.trajectory, world_from_cam=poses)
    frames = np.repeat(still.frames[:1] + np.uint8(1), len(still), axis=0)
    still = replace(still, frames=frames, trajectory=trajectory)
    prediction, context = predict(still, Wall(), hindcast=None)
    np.testing.assert_array_equal(prediction.frames[0, 0], context.frames[-1])
    np.testing.assert_array_equal(prediction.frames[0, 1], wall(poses[-1])[0])
    assert prediction.is_copy.tolist() == [[True, False]]
    assert prediction.is_trusted


def test_unusable_frames_are_not_compared() -> None:
    black = clip()
    frames = black.frames.copy()
    frames[[0, 3]] = 0
    prediction, _ = predict(replace(black, frames=frames), Wall())
    assert prediction.shown_by == "geometry"


def test_geometry_is_preferred_unless_others_are_clearly_better() -> None:
    hindcast = Hindcast(max_error_ratio=0.85)
    errors: dict[ShownBy, float] = {"geometry": 10.0, "image-motion": 8.6, "last-frame": 9.0}
    assert hindcast.verdict([errors]).shown_by == "geometry"
    assert hindcast.verdict([{**errors, "image-motion": 8.4}]).shown_by == "image-motion"
    # Means over several tests: 10 and 8.45
    assert hindcast.verdict([errors, {**errors, "image-motion": 8.3}]).shown_by == "image-motion"


def test_three_frames_are_no_test() -> None:
    context, _ = clip().split(3, GroundTruth.needs)
    mask = np.zeros(context.frames.shape[1:3], bool)
    assert not Hindcast().judge(Brighter(), context, mask).errors


@dataclass
class CountedOdometry:
    """The recorded past; counts how often it is tracked."""

    count: int = 0

    needs = PrivilegedInput.PAST_POSES

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        self.count += 1
        return RecordedPast().track(context)


def test_the_hindcast_forecasts_the_tracked_past() -> None:
    """It needs no second odometry, which would have half of the frames alone."""
    odometry = CountedOdometry()
    context, _ = clip().split(NUM_PAST, odometry.needs)
    source = Chained(odometry, ConstantVelocity())
    prediction = GeometricPredictor(source, Wall(), hindcast=HINDCAST).predict(context)
    assert odometry.count == 1
    assert prediction.shown_by == "geometry"


def test_neither_a_command_nor_too_few_frames_are_a_test() -> None:
    """Half of the frames do not suit the second renderer."""

    class Demanding(Wall):
        def reconstruct(self, context: Context, past: Trajectory) -> Wall:
            if len(past) < NUM_PAST:
                raise BadData("too few frames")
            return self

    commanded, (context, _) = Commanded(speed_m_s=1.0), clip().split(NUM_PAST, Commanded.needs)
    predictor = GeometricPredictor(commanded, Wall(offset=2.4), hindcast=HINDCAST)
    assert predictor.predict(context).is_trusted
    assert predict(clip(), Demanding(offset=2.4))[0].is_trusted


class Hasty(CameraFixedDetection):
    """A detection that takes a corner of few frames for camera-fixed."""

    def detect(self, greys: ByteArray) -> BoolArray:
        mask = np.zeros(greys.shape[1:], bool)
        mask[:10, :10] = len(greys) < NUM_PAST
        return mask


def test_the_hindcast_has_the_mask_of_all_frames() -> None:
    """On the highway, the road of a fifth of a second looked fixed to the camera."""
    masked: list[int] = []

    class Seen(Wall):
        def reconstruct(self, context: Context, past: Trajectory) -> Wall:
            assert context.observations is not None
            masked.append(int(context.observations.mask.sum()))
            return self

    context, _ = clip().split(NUM_PAST, GroundTruth.needs)
    observer = Observer(camera_fixed=Hasty())
    GeometricPredictor(GroundTruth(), Seen(), observer, HINDCAST).predict(context)
    assert masked == [0, 0]  # of six frames, and of three
