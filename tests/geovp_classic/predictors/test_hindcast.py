"""Hindcasting: scenes that do not explain the past are replaced by the last frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.predictors.hindcast import Hindcast
from geovp_classic.types import (
    Clip,
    Context,
    FloatArray,
    Intrinsics,
    Prediction,
    PrivilegedInput,
    Trajectory,
    Views,
)
from tests.geovp_classic.rendering.wall import CAMERA, at, wall

NUM_PAST, NUM_FUTURE = 6, 2


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


def predict(of: Clip, renderer: Wall) -> tuple[Prediction, Context]:
    context, _ = of.split(NUM_PAST, GroundTruth.needs)
    return GeometricPredictor(GroundTruth(), renderer).predict(context), context


@pytest.mark.parametrize("renderer", [Wall(), Wall(gain=0.5), Wall(offset=0.2)])
def test_a_scene_that_explains_the_past_is_shown(renderer: Wall) -> None:
    prediction, context = predict(clip(), renderer)
    expected = renderer.view(context.future.world_from_cam, np.zeros(2), CAMERA).frames
    np.testing.assert_array_equal(prediction.frames[0], expected)


@pytest.mark.parametrize("renderer", [Wall(offset=2.4), Wall(is_covered=False)])
def test_the_last_frame_replaces_a_scene_that_does_not(renderer: Wall) -> None:
    prediction, context = predict(clip(), renderer)
    assert (prediction.frames == context.frames[-1]).all()
    assert (prediction.confidence < predict(clip(), Wall())[0].confidence).all()


def test_a_prediction_records_what_it_shows() -> None:
    shown, _ = predict(clip(), Wall())
    assert (shown.shown_by, shown.is_trusted) == ("geometry", True)
    assert not shown.copied.any()
    assert shown.covered.all()
    replaced, _ = predict(clip(), Wall(offset=2.4))
    assert (replaced.shown_by, replaced.is_trusted) == ("last-frame", False)
    assert replaced.is_copy.tolist() == [[True, True]]
    assert not replaced.covered.any()


@pytest.mark.parametrize("size_px", [(80, 60), (320, 240)])
def test_in_any_size_the_last_frame_replaces_an_untrusted_scene(size_px: tuple[int, int]) -> None:
    context, _ = clip().split(NUM_PAST, GroundTruth.needs)
    predictor = GeometricPredictor(GroundTruth(), Wall(offset=2.4))
    scene = predictor.reconstruct(predictor.observe(context), context.past)
    futures = context.future.world_from_cam
    views = scene.view(futures, np.zeros(2), CAMERA.resized(*size_px))
    last = pinhole.resize(context.frames[-1], size_px)
    np.testing.assert_array_equal(views.frames, [last, last])
    assert not views.covered.any()


def test_in_half_the_size_the_mask_is_half_as_large() -> None:
    context, _ = clip().split(NUM_PAST, GroundTruth.needs)
    predictor = GeometricPredictor(GroundTruth(), Wall())
    scene = predictor.reconstruct(predictor.observe(context), context.past)
    mask = np.zeros(context.frames.shape[1:3], bool)
    mask[-40:] = True
    small = CAMERA.resized(CAMERA.width_px // 2, CAMERA.height_px // 2)
    copied = replace(scene, mask=mask).copied(context.future.world_from_cam, small)
    assert copied[:, -20:].all()
    assert not copied[:, :-20].any()


def test_without_a_hindcast_the_scene_is_shown() -> None:
    context, _ = clip().split(NUM_PAST, GroundTruth.needs)
    renderer = Wall(offset=2.4)
    prediction = GeometricPredictor(GroundTruth(), renderer, hindcast=None).predict(context)
    expected = renderer.view(context.future.world_from_cam, np.zeros(2), CAMERA).frames
    np.testing.assert_array_equal(prediction.frames[0], expected)
    assert prediction.is_trusted


def test_confidence_falls_with_the_error_and_the_step() -> None:
    right = predict(clip(), Wall())[0].confidence
    worse = predict(clip(), Wall(offset=0.2))[0].confidence
    # 6 tracked frames of the 7 and 8 up to each step
    assert right[0, 1] / right[0, 0] == pytest.approx((6 / 8) / (6 / 7))
    assert (worse > 0).all()
    assert (worse < 0.98 * right).all()


def test_a_stationary_past_tests_no_scene_but_the_last_pose_shows_the_last_frame() -> None:
    still = clip(step=0.0)
    poses = np.repeat(still.trajectory.world_from_cam[:1], NUM_PAST + NUM_FUTURE, axis=0)
    poses[-1, 0, 3] = 0.6  # it departs
    trajectory = replace(still.trajectory, world_from_cam=poses)
    frames = np.repeat(still.frames[:1] + np.uint8(1), len(still), axis=0)
    prediction, context = predict(replace(still, frames=frames, trajectory=trajectory), Wall())
    np.testing.assert_array_equal(prediction.frames[0, 0], context.frames[-1])
    np.testing.assert_array_equal(prediction.frames[0, 1], wall(poses[-1])[0])
    assert prediction.is_copy.tolist() == [[True, False]]
    assert prediction.is_trusted


def test_unusable_frames_are_not_compared() -> None:
    black = clip()
    frames = black.frames.copy()
    frames[[0, 2, 3]] = 0
    context, _ = replace(black, frames=frames).split(NUM_PAST, GroundTruth.needs)
    predictor = GeometricPredictor(GroundTruth(), Wall())
    observed = predictor.observe(context)
    assert predictor.reconstruct(observed, context.past).error_ratio < 0.05


def test_a_single_frame_is_no_test() -> None:
    context, _ = clip().split(1, GroundTruth.needs)
    observed = GeometricPredictor(GroundTruth(), Wall()).observe(context)
    assert Hindcast().errors(Wall(offset=2.4), observed.context, context.past)[0] == 0


def test_settings_without_a_test_are_refused() -> None:
    with pytest.raises(BadData, match="num_frames 0"):
        Hindcast(num_frames=0)
    with pytest.raises(BadData, match="scale 0"):
        Hindcast(scale=0.0)


@pytest.mark.parametrize(
    ("size_px", "view_px"),
    [((1240, 376), (620, 188)), ((256, 192), (128, 96)), ((160, 80), (128, 64)), ((96, 72),) * 2],
)
def test_views_are_half_as_large_but_not_below_128_px(
    size_px: tuple[int, int], view_px: tuple[int, int]
) -> None:
    assert Hindcast().view_size(CAMERA.resized(*size_px)) == view_px
