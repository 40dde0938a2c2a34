"""The nouns are checked at the door and read-only inside."""

from dataclasses import replace

import numpy as np
import pytest

from geovp_classic.errors import BadData
from geovp_classic.types import (
    Clip,
    ExtraView,
    Intrinsics,
    Motion,
    Prediction,
    PrivilegedInput,
    Trajectory,
    Views,
)

CAMERA = Intrinsics(50, 50, 15.5, 11.5, 32, 24)


def trajectory(steps: int, is_metric: bool = True) -> Trajectory:
    poses = np.tile(np.eye(4), (steps, 1, 1))
    poses[:, 2, 3] = np.arange(steps)
    return Trajectory(poses, np.arange(steps) * 0.1, is_metric)


def full_clip(steps: int = 6) -> Clip:
    frames = np.arange(steps, dtype=np.uint8)[:, None, None, None] * np.ones(
        (1, 24, 32, 3), np.uint8
    )
    extra = ExtraView(
        np.zeros((steps, 24, 48, 3), np.uint8), Intrinsics(50, 50, 23.5, 11.5, 48, 24), np.eye(4)
    )
    depths, moving = np.ones((steps, 24, 32), np.float32), np.zeros((steps, 24, 32), bool)
    return Clip(
        "street/000",
        frames,
        np.arange(steps) * 0.1,
        CAMERA,
        trajectory(steps),
        depths,
        moving,
        extra,
        extra,
        1.65,
    )


def test_trajectories_refuse_what_is_not_a_motion() -> None:
    good = trajectory(3)
    nan, bent, mirrored = (good.world_from_cam.copy() for _ in range(3))
    nan[1, 0, 3] = np.nan
    bent[2, 0, 0] = 1.01
    mirrored[0, 0, 0] = -1
    for poses, message in (
        (nan, "pose 1 has a number that is not finite"),
        (bent, "pose 2 is not rigid"),
        (mirrored, "pose 0 is not rigid"),
        (np.eye(3)[None], r"expected \[..., 4, 4\]"),
    ):
        with pytest.raises(BadData, match=message):
            Trajectory(poses, good.times_s[: len(poses)], True)
    for times_s, message in (
        (np.array([0, 0.1]), r"expected \(3,\)"),
        (np.array([0, 0.2, 0.2]), "step 2 is not later"),
        (np.array([0, np.nan, 1]), "not finite"),
    ):
        with pytest.raises(BadData, match=message):
            Trajectory(good.world_from_cam, times_s, True)


def test_arrays_are_read_only_inside_and_the_giver_keeps_his_own() -> None:
    poses = np.tile(np.eye(4), (2, 1, 1))
    held = Trajectory(poses, np.array([0.0, 1]), True)
    with pytest.raises(ValueError, match="read-only"):
        held.world_from_cam[0, 0, 0] = 2
    poses[0, 0, 3] = 1.0  # the array that was given stays writeable
    with pytest.raises(ValueError, match="read-only"):
        full_clip().frames[0] = 0


def test_slices_and_joins_keep_the_frame() -> None:
    whole = trajectory(6)
    assert len(whole[2:5]) == 3
    np.testing.assert_array_equal(whole[:2].then(whole[2:]).world_from_cam, whole.world_from_cam)
    with pytest.raises(BadData, match="cannot be joined"):
        whole[:2].then(Trajectory(whole.world_from_cam[2:], whole.times_s[2:], False))
    with pytest.raises(BadData, match="not later"):
        whole[3:].then(whole[:3])


def test_only_metres_have_an_uncertainty_and_slices_keep_it() -> None:
    whole = replace(trajectory(4), scale_uncertainty=0.5)
    assert whole[:2].then(whole[2:]).scale_uncertainty == 0.5
    for wrong in (-0.1, np.nan, np.inf):
        with pytest.raises(BadData, match="scale_uncertainty"):
            replace(whole, scale_uncertainty=wrong)
    with pytest.raises(BadData, match="of a metric trajectory"):
        replace(whole, is_metric=False)


def test_a_split_gives_the_past_to_the_context_and_the_future_to_the_target() -> None:
    clip = full_clip(6)
    context, target = clip.split(
        4, PrivilegedInput.PAST_POSES | PrivilegedInput.FULL_FRAMES | PrivilegedInput.PAST_DEPTHS
    )
    assert (context.num_past, context.num_future) == (4, 2)
    np.testing.assert_array_equal(context.frames[:, 0, 0, 0], [0, 1, 2, 3])
    np.testing.assert_array_equal(target.frames[:, 0, 0, 0], [4, 5])
    assert (len(context.past), len(context.full.frames), len(context.times_s)) == (4, 4, 6)
    np.testing.assert_array_equal(target.trajectory.world_from_cam[:, 2, 3], [4, 5])
    for num_past in (0, 6):
        with pytest.raises(BadData, match="expected 1 to 5"):
            clip.split(num_past, PrivilegedInput.NONE)


def test_clips_refuse_parts_that_do_not_fit() -> None:
    clip = full_clip(3)
    with pytest.raises(BadData, match="2 poses for 3 frames"):
        Clip("a", clip.frames, clip.times_s, CAMERA, trajectory(2))
    with pytest.raises(BadData, match="frames: uint8 array of shape"):
        Clip("a", clip.frames[:, :-1], clip.times_s, CAMERA)
    with pytest.raises(BadData, match="frames: float64"):
        Clip("a", clip.frames.astype(float), clip.times_s, CAMERA)
    with pytest.raises(BadData, match="depths: float64"):
        Clip("a", clip.frames, clip.times_s, CAMERA, depths=np.ones((3, 24, 32)))
    extra = ExtraView(np.zeros((2, 24, 32, 3), np.uint8), CAMERA, np.eye(4))
    with pytest.raises(BadData, match="2 wide frames for 3"):
        Clip("a", clip.frames, clip.times_s, CAMERA, full=extra)


def test_intrinsics_must_be_positive_and_finite() -> None:
    for wrong in ((0, 50, 1, 1, 4, 4), (50, 50, float("nan"), 1, 4, 4), (50, 50, 1, 1, 0, 4)):
        with pytest.raises(BadData, match="positive"):
            Intrinsics(*wrong)


def test_motions_views_and_predictions_are_checked() -> None:
    past = trajectory(2)
    with pytest.raises(BadData, match=r"expected \[S, F, 4, 4\]"):
        Motion(past, np.tile(np.eye(4), (3, 1, 1)), np.ones(2, bool))
    bad = np.tile(np.eye(4), (2, 3, 1, 1))
    bad[1, 2, 0, 0] = 5
    with pytest.raises(BadData, match=r"pose \(1, 2\) is not rigid"):
        Motion(past, bad, np.ones(2, bool))
    with pytest.raises(BadData, match="tracked"):
        Motion(past, bad[:1], np.ones(3, bool))
    covered = np.ones((2, 4, 4), bool)
    with pytest.raises(BadData, match="depths: float64"):
        Views(np.zeros((2, 4, 4, 3), np.uint8), covered, np.ones((2, 4, 4)))
    with pytest.raises(BadData, match=r"expected \[S, F, H, W, 3\]"):
        Prediction(np.zeros((2, 4, 4, 3), np.uint8))
    with pytest.raises(BadData, match="coverage"):
        Prediction(np.zeros((1, 2, 4, 4, 3), np.uint8), covered)


def test_confidence_is_what_was_seen_and_tracked_of_all_frames_until_then() -> None:
    covered = np.ones((2, 3, 4, 4), bool)
    covered[1, 2, :, 0] = False  # a quarter of the second sample's third frame is invented
    motion = Motion(
        trajectory(4), np.tile(np.eye(4), (1, 3, 1, 1)), np.array([True, True, False, True])
    )
    frames = np.zeros((2, 3, 4, 4, 3), np.uint8)
    confidence = Prediction(frames, covered, motion).confidence
    np.testing.assert_allclose(confidence, [[3 / 5, 3 / 6, 3 / 7], [3 / 5, 3 / 6, 0.75 * 3 / 7]])
    assert Prediction(frames).confidence is Prediction(frames, covered).confidence is None
