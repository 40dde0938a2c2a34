"""Predictors without geometry: mean frame, extrapolated optical flow, extrapolated homography."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from geovp_classic.errors import Incompatible
from geovp_classic.interfaces import FramePredictor
from geovp_classic.predictors.flow_extrapolation import FlowExtrapolation
from geovp_classic.predictors.homography_extrapolation import HomographyExtrapolation
from geovp_classic.predictors.mean_frame import MeanFrame
from geovp_classic.types import ByteArray, Clip, Context, FloatArray, Intrinsics, PrivilegedInput

SIZE_PX = 96
CAMERA = Intrinsics(90.0, 90.0, 47.5, 47.5, SIZE_PX, SIZE_PX)
NUM_PAST, NUM_FUTURE = 4, 5
NONE = PrivilegedInput.NONE
STEPS = np.arange(NUM_PAST + NUM_FUTURE) - (NUM_PAST - 1)  # 0 = the last observed frame


def filmed(canvas_from_frame: list[FloatArray], times_s: FloatArray | None = None) -> Clip:
    """Return a film of a large random texture, one homography [3, 3] per frame."""
    rng = np.random.default_rng(4)
    coarse = rng.uniform(20, 235, (75, 75, 3)).astype(np.float32)
    canvas = cv2.resize(coarse, (300, 300), interpolation=cv2.INTER_CUBIC).clip(0, 255)
    centre = np.array([[1, 0, 100], [0, 1, 100], [0, 0, 1.0]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    frames = [
        cv2.warpPerspective(canvas, centre @ homography, (SIZE_PX, SIZE_PX), flags=flags)
        for homography in canvas_from_frame
    ]
    times_s = 0.1 * np.arange(len(frames)) if times_s is None else times_s
    return Clip("film", np.stack(frames).clip(0, 255).astype(np.uint8), times_s, CAMERA)


def shifts(pixels: FloatArray) -> list[FloatArray]:
    return [np.array([[1, 0, shift], [0, 1, 0], [0, 0, 1.0]]) for shift in pixels]


def errors(predictor: FramePredictor, clip: Clip) -> tuple[FloatArray, FloatArray]:
    """Return the mean absolute error of covered pixels, and their fraction, for each step [F]."""
    context, target = clip.split(NUM_PAST, NONE)
    prediction = predictor.predict(context)
    covered = prediction.covered[0]
    difference = np.abs(prediction.frames[0].astype(float) - target.frames).mean(axis=-1)
    return (difference * covered).sum((1, 2)) / covered.sum((1, 2)), covered.mean((1, 2))


def copied_errors(clip: Clip) -> FloatArray:
    context, target = clip.split(NUM_PAST, NONE)
    last: ByteArray = context.frames[-1]
    return np.abs(last.astype(float) - target.frames).mean((1, 2, 3))


def test_the_mean_frame_is_repeated() -> None:
    clip = filmed(shifts(STEPS * 3.0))
    context, _ = clip.split(NUM_PAST, NONE)
    frames = MeanFrame().predict(context, num_samples=3).frames
    assert frames.shape == (1, NUM_FUTURE, SIZE_PX, SIZE_PX, 3)
    assert np.abs(frames[0] - clip.frames[:NUM_PAST].mean(axis=0)).max() <= 0.5


@pytest.mark.parametrize("predictor", [FlowExtrapolation(), HomographyExtrapolation()])
def test_a_constant_shift_goes_on_and_what_enters_is_marked(predictor: FramePredictor) -> None:
    clip = filmed(shifts(STEPS * 3.0))
    error, covered = errors(predictor, clip)
    assert (error < 0.15 * copied_errors(clip)).all()
    entered = 1 - 3.0 * np.arange(1, NUM_FUTURE + 1) / SIZE_PX
    np.testing.assert_allclose(covered, entered, atol=0.04)


def test_a_turning_camera_moves_the_whole_image_by_a_homography() -> None:
    matrix = CAMERA.matrix
    turns = [
        matrix @ cv2.Rodrigues(np.array([0.0, 0.03 * step, 0.02 * step]))[0] @ np.linalg.inv(matrix)
        for step in STEPS
    ]
    clip = filmed(turns)
    error, _ = errors(HomographyExtrapolation(), clip)
    assert (error < 0.15 * copied_errors(clip)).all()


@pytest.mark.parametrize("predictor", [FlowExtrapolation(), HomographyExtrapolation()])
def test_motion_is_per_second(predictor: FramePredictor) -> None:
    """The last observed interval is twice as long as those to predict."""
    times_s = np.array([0.0, 0.1, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
    clip = filmed(shifts(20 * (times_s - 0.4)), times_s)
    error, _ = errors(predictor, clip)
    assert (error < 0.15 * copied_errors(clip)).all()


@pytest.mark.parametrize("predictor", [FlowExtrapolation(), HomographyExtrapolation()])
def test_one_frame_has_no_motion(predictor: FramePredictor) -> None:
    context, _ = filmed(shifts(STEPS * 3.0)).split(1, NONE)
    with pytest.raises(Incompatible, match="give num_past of 2 or more"):
        predictor.predict(context)


def test_a_frame_without_corners_has_no_homography() -> None:
    clip = filmed(shifts(STEPS * 3.0))
    rows = np.linspace(50, 200, SIZE_PX, dtype=np.uint8)
    smooth = np.broadcast_to(rows[:, None, None], clip.frames.shape)
    context: Context = Clip("smooth", smooth.copy(), clip.times_s, CAMERA).split(NUM_PAST, NONE)[0]
    with pytest.raises(Incompatible, match="expected 8 or more"):
        HomographyExtrapolation().predict(context)
