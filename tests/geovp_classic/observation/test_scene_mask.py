"""The scene mask: letterbox bars and camera-fixed pixels, hidden from components, and shown."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.interfaces import Scene
from geovp_classic.observation import Observer
from geovp_classic.observation.camera_fixed import CameraFixedDetection
from geovp_classic.observation.scene_mask import read_mask, scene_window
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    Context,
    ExtraView,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
    Views,
)

SIDE = 96


def greys_of(frames: ByteArray) -> ByteArray:
    return np.stack([pinhole.grey8(frame) for frame in frames])


def scene_mask(frames: ByteArray) -> BoolArray:
    """The letterbox bars alone."""
    return Observer(camera_fixed=None).scene(greys_of(frames))[0]


def vehicle_mask(frames: ByteArray) -> BoolArray:
    return CameraFixedDetection().detect(greys_of(frames))


def top_row(mask: BoolArray) -> int:
    return scene_window(mask)[0].stop


@pytest.fixture(scope="module")
def clip() -> Clip:
    """Twelve frames of a street."""
    return Synthetic(seed=3, num_clips=1, num_frames=12, size_px=(SIDE, SIDE), with_full=True)[0]


def arched(height: int, width: int, fraction: float = 0.2) -> BoolArray:
    """A hood [H, W] that covers this fraction of the middle column and half as much of the outer ones."""
    row, column = np.mgrid[:height, :width]
    return np.asarray(
        row >= height * (1 - fraction * (1 - 0.5 * (2 * column / (width - 1) - 1) ** 2))
    )


def painted(frames: ByteArray, mask: BoolArray) -> ByteArray:
    """The frames with a blue hood and its bright rim, six pixels wide."""
    inside = cv2.erode(mask.astype(np.uint8), np.ones((7, 13)), borderValue=1)
    hood = np.where(inside[..., None] > 0, [40.0, 50.0, 110.0], [210.0, 215.0, 225.0])
    noisy = np.random.default_rng(0).normal(hood, 1.0, frames.shape).clip(0, 255)
    return np.where(mask[..., None], noisy, frames).astype(np.uint8)


@pytest.mark.parametrize(
    "bars", [(12, 12, 0, 0), (0, 15, 0, 0), (0, 0, 20, 9), (5, 6, 7, 8), (0, 0, 0, 0)]
)
def test_letterbox_bars_are_masked(clip: Clip, bars: tuple[int, ...]) -> None:
    top, bottom, left, right = bars
    frames = np.zeros_like(clip.frames[:10])
    image = slice(top, SIDE - bottom), slice(left, SIDE - right)
    frames[:, *image] = clip.frames[:10, *image]
    mask = scene_mask(frames)
    (rows, columns) = scene_window(mask)
    found = rows.start, SIDE - rows.stop, columns.start, SIDE - columns.stop
    assert found == tuple(
        bar + 2 * (bar > 0) for bar in bars
    )  # the image's border is blended with the bar
    assert not mask[rows, columns].any()


def test_dark_footage_is_not_letterboxing(clip: Clip) -> None:
    dark = clip.frames[:10].copy()
    dark[:, : SIDE // 2 + 1] = 3
    assert not scene_mask(dark).any()
    assert not scene_mask(np.zeros_like(dark)).any()
    dim = clip.frames[:10] // 12
    assert dim.max() > 20 >= dim[:, 0].max()  # the sky's upper edge would be a bar
    assert not scene_mask(dim).any()


class Noted:
    """A renderer of one grey value that keeps what it was given."""

    needs = ~PrivilegedInput.RIGHT_FRAMES

    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        self.context = context
        return self

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        shape = (len(world_from_cam), intrinsics.height_px, intrinsics.width_px)
        return Views(
            np.full((*shape, 3), 77, np.uint8), np.zeros(shape, bool), np.zeros(shape, np.float32)
        )


def hooded(clip: Clip, mask: BoolArray) -> Clip:
    wide = clip.full.frames
    covered = arched(wide.shape[1], wide.shape[2], 0.15)
    view = ExtraView(painted(wide, covered), clip.full.intrinsics, clip.full.view_from_cam)
    return replace(
        clip,
        frames=painted(clip.frames, mask),
        full=view,
        depths=np.ones(clip.frames.shape[:3], np.float32),
    )


def test_a_hood_is_hidden_from_the_renderer_and_shown_in_each_view(clip: Clip) -> None:
    mask = arched(SIDE, SIDE)
    renderer = Noted()
    predictor = GeometricPredictor(GroundTruth(), renderer)
    context, _ = hooded(clip, mask).split(10, renderer.needs)
    prediction = predictor.predict(context)
    seen = renderer.context
    assert abs(seen.intrinsics.height_px - SIDE * 0.8) <= 3
    assert seen.frames.shape == (10, seen.intrinsics.height_px, SIDE, 3)
    assert seen.past_depths.shape == seen.frames.shape[:3]
    assert seen.intrinsics == context.intrinsics.cropped(0, 0, SIDE, seen.intrinsics.height_px)
    assert abs(seen.full.intrinsics.height_px - context.full.intrinsics.height_px * 0.85) <= 3
    found = vehicle_mask(context.frames)
    shown = np.where(found[..., None], context.frames[-1], 77)
    np.testing.assert_array_equal(prediction.frames[0], [shown] * 2)
    assert not prediction.covered.any()  # copies do not count
    scene = predictor.reconstruct(predictor.observe(context), context.past)
    other = context.intrinsics.cropped(0, 0, 50, 40)  # another field of view: the scene alone
    assert (scene.view(np.eye(4)[None], context.times_s[-1:], other).frames == 77).all()


def test_a_hood_that_only_uncropped_frames_show_is_hidden_with_these_alone(clip: Clip) -> None:
    context, _ = hooded(clip, np.zeros((SIDE, SIDE), bool)).split(10, Noted.needs)
    assert not vehicle_mask(context.frames).any()
    top = top_row(vehicle_mask(context.full.frames))
    assert top < SIDE
    assert context.full.intrinsics.cropped(111, 0, SIDE, SIDE) == context.intrinsics
    observed = Observer().observe(context)
    assert not observed.crop_mask(PrivilegedInput.NONE).any()
    assert abs(top_row(observed.crop_mask(PrivilegedInput.FULL_FRAMES)) - top) <= 1


def drawn(path: Path, shape: tuple[int, int], masked: tuple[slice, slice]) -> Path:
    """Write a mask of that shape (H, W) that is nonzero in a rectangle."""
    mask = np.zeros(shape, np.uint8)
    mask[masked] = 255
    cv2.imwrite(str(path), mask)
    return path


def test_a_drawn_mask_of_any_size_hides_pixels(clip: Clip, tmp_path: Path) -> None:
    context, _ = replace(clip, full=None).split(10, PrivilegedInput.NONE)
    half = drawn(tmp_path / "mask.png", (SIDE // 2, SIDE // 2), np.s_[40:, 10:])
    observed = Observer(mask=half).observe(context)
    expected = np.zeros((SIDE, SIDE), bool)
    expected[80:, 20:] = True
    np.testing.assert_array_equal(observed.mask, expected)
    np.testing.assert_array_equal(observed.context.frames, context.frames[:, :80])


def test_a_mask_with_16_bits_is_read_and_one_with_transparency_refused(tmp_path: Path) -> None:
    path = tmp_path / "mask.png"
    cv2.imwrite(str(path), np.array([[0, 1], [255, 256]], np.uint16))
    assert read_mask(path, 2, 2).tolist() == [[False, True], [True, True]]
    for shape, mode in (((2, 2, 4), "RGBA"), ((2, 2, 2), "LA")):
        pixels = np.full(shape, 255, np.uint8)
        Image.fromarray(pixels, mode).save(path)
        assert read_mask(path, 2, 2).all()
        pixels[0, 0, -1] = 0
        Image.fromarray(pixels, mode).save(path)
        with pytest.raises(BadData, match="has transparent pixels"):
            read_mask(path, 2, 2)


def test_a_drawn_mask_of_uncropped_frames_covers_their_crop(clip: Clip, tmp_path: Path) -> None:
    context, _ = clip.split(10, PrivilegedInput.FULL_FRAMES)
    shape = context.full.frames.shape[1:3]
    observed = Observer(mask=drawn(tmp_path / "mask.png", shape, np.s_[80:, :])).observe(context)
    assert observed.context.intrinsics.height_px == 80
    assert observed.context.full.intrinsics.height_px == 80


@pytest.mark.parametrize(
    ("shape", "masked", "message"),
    [
        ((SIDE, 2 * SIDE), np.s_[80:, :], "has 192x96 pixels, the frames 96x96"),
        ((SIDE, SIDE), np.s_[:, 10:], "leaves 10x96 of 96x96 pixels"),
    ],
)
def test_an_unsuitable_drawn_mask_is_refused(
    clip: Clip, tmp_path: Path, shape: tuple[int, int], masked: tuple[slice, slice], message: str
) -> None:
    path = tmp_path / "mask.png"
    drawn(path, shape, masked)
    context, _ = replace(clip, full=None).split(10, PrivilegedInput.NONE)
    with pytest.raises(BadData, match=message):
        Observer(mask=path).observe(context)
