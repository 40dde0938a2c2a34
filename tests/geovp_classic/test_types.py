"""Data types check their arrays at construction and are read-only afterwards."""

from dataclasses import replace
from typing import Any

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
IDENTITY = np.eye(4)


def trajectory(num_steps: int, is_metric: bool = True) -> Trajectory:
    poses = np.tile(IDENTITY, (num_steps, 1, 1))
    poses[:, 2, 3] = np.arange(num_steps)
    return Trajectory(poses, np.arange(num_steps) * 0.1, is_metric)


def full_clip(num_steps: int = 6) -> Clip:
    levels = np.arange(num_steps, dtype=np.uint8)[:, None, None, None]
    view = ExtraView(np.zeros((num_steps, 24, 32, 3), np.uint8), CAMERA, IDENTITY)
    return Clip(
        "street/000",
        frames=np.tile(levels, (1, 24, 32, 3)),
        times_s=np.arange(num_steps) * 0.1,
        intrinsics=CAMERA,
        trajectory=trajectory(num_steps),
        depths=np.ones((num_steps, 24, 32), np.float32),
        moving=np.zeros((num_steps, 24, 32), bool),
        full=view,
        right=view,
        camera_height_m=1.65,
    )


@pytest.mark.parametrize(
    ("row", "column", "value"),
    [(0, 3, np.nan), (0, 3, np.inf), (0, 0, np.nan), (0, 0, 1.01), (0, 0, -1), (3, 0, 1)],
)
def test_poses_are_rigid_and_finite(row: int, column: int, value: float) -> None:
    poses = np.tile(IDENTITY, (2, 3, 1, 1))
    poses[1, 2, row, column] = value
    with pytest.raises(BadData, match=r"world_from_cam: pose \[2\] is not rigid"):
        Trajectory(poses[1], np.arange(3.0), True)
    with pytest.raises(BadData, match=r"futures: pose \[1, 2\] is not rigid"):
        Motion(trajectory(2), poses, np.ones(2, bool))


@pytest.mark.parametrize("times_s", [[0, 0.1], [0, 0.2, 0.2], [0, 1, 0.5], [np.nan, 1, 2]])
def test_each_pose_has_a_later_time_than_the_last(times_s: list[float]) -> None:
    with pytest.raises(BadData, match="times_s"):
        Trajectory(trajectory(3).world_from_cam, np.array(times_s), True)


def test_stored_arrays_are_read_only_and_given_arrays_stay_writeable() -> None:
    poses = np.tile(IDENTITY, (2, 1, 1))
    stored = Trajectory(poses, np.array([0.0, 1]), True)
    for array in (stored.world_from_cam, full_clip().frames):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    poses[0, 0, 3] = 1.0


def test_only_metric_lengths_have_an_uncertainty() -> None:
    for uncertainty in (-0.1, np.nan, np.inf):
        with pytest.raises(BadData, match="scale_uncertainty"):
            replace(trajectory(4), scale_uncertainty=uncertainty)
    with pytest.raises(BadData, match="of a metric trajectory"):
        replace(trajectory(4, is_metric=False), scale_uncertainty=0.5)


def test_a_split_gives_the_past_to_the_context_and_the_future_to_the_target() -> None:
    clip = full_clip(6)
    context, target = clip.split(4, PrivilegedInput.PAST_POSES | PrivilegedInput.FULL_FRAMES)
    assert (context.num_past, context.num_future) == (4, 2)
    assert context.frames[:, 0, 0, 0].tolist() == [0, 1, 2, 3]
    assert target.frames[:, 0, 0, 0].tolist() == [4, 5]
    assert (len(context.past), len(context.full), len(context.times_s)) == (4, 4, 6)
    assert target.trajectory.world_from_cam[:, 2, 3].tolist() == [4, 5]
    assert context.past_depths is None
    for num_past in (0, 6):
        with pytest.raises(BadData, match="expected 1 to 5"):
            clip.split(num_past, PrivilegedInput.NONE)


def test_a_context_can_be_reduced_to_some_frames() -> None:
    context, _ = full_clip(6).split(4, ~PrivilegedInput.NONE)
    recent = context.recent(2)
    assert recent.frames[:, 0, 0, 0].tolist() == [2, 3]
    assert recent.past.world_from_cam[:, 2, 3].tolist() == [2, 3]
    np.testing.assert_allclose(recent.times_s, [0.2, 0.3, 0.4, 0.5])
    assert context.recent(9) is context


@pytest.mark.parametrize(
    "fields",
    [
        {"trajectory": trajectory(2)},
        {"frames": full_clip(3).frames[:, :-1]},
        {"frames": full_clip(3).frames.astype(float)},
        {"depths": np.ones((3, 24, 32))},
        {"moving": np.ones((3, 24, 31), bool)},
        {"full": full_clip(2).full},
        {"times_s": np.arange(2)},
        {"camera_height_m": -1.0},
    ],
)
def test_a_clip_refuses_fields_that_do_not_fit(fields: dict[str, Any]) -> None:
    with pytest.raises(BadData, match=f"street/000: {next(iter(fields))}"):
        replace(full_clip(3), **fields)


@pytest.mark.parametrize(
    "fields",
    [
        {"frames": np.zeros((0, 24, 32, 3), np.uint8)},
        {"times_s": np.arange(2)},
        {"past": trajectory(3)},
        {"future": trajectory(2)},
        {"camera_height_m": float("nan")},
    ],
)
def test_a_context_refuses_fields_that_do_not_fit(fields: dict[str, Any]) -> None:
    context, _ = full_clip(3).split(2, ~PrivilegedInput.NONE)
    with pytest.raises(BadData, match="expected"):
        replace(context, **fields)


def test_intrinsics_are_positive_finite_and_of_whole_pixels() -> None:
    with pytest.raises(BadData, match="whole number of pixels"):
        Intrinsics(50, 50, 1, 1, 4, 4.0)
    for numbers in ((0, 50, 1, 1, 4, 4), (50, 50, float("nan"), 1, 4, 4), (50, 50, 1, 1, 0, 4)):
        with pytest.raises(BadData, match="positive"):
            Intrinsics(*numbers)


def test_outputs_have_the_expected_shapes_and_types() -> None:
    frames, covered = np.zeros((2, 4, 4, 3), np.uint8), np.ones((2, 4, 4), bool)
    with pytest.raises(BadData, match="futures has shape"):
        Motion(trajectory(2), np.tile(IDENTITY, (3, 1, 1)), np.ones(2, bool))
    with pytest.raises(BadData, match="depths is a float64 array"):
        Views(frames, covered, np.ones((2, 4, 4)))
    with pytest.raises(BadData, match="expected"):
        Prediction(frames)
    with pytest.raises(BadData, match="covered"):
        Prediction(frames[None], covered)
    with pytest.raises(BadData, match="confidence"):
        Prediction(frames[None], confidence=np.array([[0.5, 1.1]]))
