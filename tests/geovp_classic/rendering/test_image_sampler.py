"""Reading a view's pixels from many images against a slow twin that reads the whole view from each
source.
"""

import cv2
import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.rendering import patches
from geovp_classic.rendering.image_sampler import ImageSampler, ImageStack, resampled
from geovp_classic.rendering.rasterizer import NO_INDEX
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

CAMERA = Intrinsics(40.0, 44.0, 19.5, 15.5, 40, 32)
SOURCE_CAMERA = Intrinsics(30.0, 30.0, 24.0, 17.5, 49, 36)


def image(rng: np.random.Generator, size: tuple[int, int], is_grey: bool) -> ByteArray:
    """A smooth image [H, W, 3]."""
    noise = rng.uniform(0, 255, (*size, 1 if is_grey else 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5).reshape(*size, -1)
    return np.repeat(smooth, 3 if is_grey else 1, axis=-1).astype(np.uint8)


def sources(rng: np.random.Generator, is_grey: bool, with_detail: bool) -> list[patches.Source]:
    twists = np.array(
        [[0, 0, 0, 0, 0, 0], [0.3, 0.1, -0.4, 0.02, -0.1, 0.1], [-0.5, 0, 0.2, 0, 0.3, 0]]
    )
    detail = (72, 98) if with_detail else None
    return [
        patches.Source(
            image(rng, (36, 49), is_grey),
            SOURCE_CAMERA,
            se3.exp(twist),
            None if detail is None else image(rng, detail, is_grey),
        )
        for twist in twists
    ]


def lanczos(frame: ByteArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Colours [H, W, 3] at (u, v), 64 pixels of the frame [H', W', 3] each; the border's colours
    outside.
    """

    def weights(offset: FloatArray) -> FloatArray:
        weight = np.sinc(offset) * np.sinc(offset / 4)
        return weight / weight.sum(axis=-1, keepdims=True)

    rows, columns = (np.floor(axis).astype(int)[..., None] + np.arange(-3, 5) for axis in (v, u))
    down, across = weights(v[..., None] - rows), weights(u[..., None] - columns)
    rows, columns = np.clip(rows, 0, frame.shape[0] - 1), np.clip(columns, 0, frame.shape[1] - 1)
    around = frame[rows[..., :, None], columns[..., None, :]].astype(float)
    return np.clip(np.einsum("hwi,hwj,hwijc->hwc", down, across, around), 0, 255)


def slow_sample(
    source: patches.Source, inverse_depth: FloatArray, pose: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The whole view [H, W, 3] from one source, where that shows it [H, W], and the depth ratio [H,
    W].
    """
    pixels, ratio = patches.source_pixels(source, inverse_depth, pose, CAMERA)
    u, v = pixels[..., 0], pixels[..., 1]
    inside = (ratio > 0.001) & (u >= -0.5) & (v >= -0.5) & (u <= 48.5) & (v <= 35.5)
    view = lanczos(source.frame, u, v)
    if source.detail is not None:
        fine_u, fine_v = (2 * (axis + 0.5) - 0.5 for axis in (u, v))
        fine = lanczos(source.detail, fine_u, fine_v)
        view += np.clip(ratio * CAMERA.fx_px / SOURCE_CAMERA.fx_px - 1, 0, 1)[..., None] * (
            fine - view
        )
    return view, inside, ratio


@pytest.mark.parametrize("is_grey", [True, False])
@pytest.mark.parametrize("with_detail", [True, False])
def test_each_pixel_is_what_its_source_shows(is_grey: bool, with_detail: bool) -> None:
    rng = np.random.default_rng(0)
    seen = sources(rng, is_grey, with_detail)
    inverse_depth = rng.uniform(0, 0.6, (32, 40)).astype(np.float32)
    inverse_depth[:5] = 0
    source_index = rng.integers(NO_INDEX, 3, (32, 40)).astype(np.int32)
    pose = se3.exp(np.array([0.2, -0.1, 0.8, 0.05, 0.1, -0.02]))
    frame, covered, magnification = ImageSampler.of(seen, CAMERA).sample(
        inverse_depth, source_index, pose
    )
    assert 0.3 < covered.mean() < 0.8  # a quarter is nowhere, some of the rest beside the sources
    assert not frame[~covered].any()
    for n, source in enumerate(seen):
        view, inside, ratio = slow_sample(source, inverse_depth, pose)
        mine = source_index == n
        np.testing.assert_array_equal(covered[mine], inside[mine])
        shown_by = mine & inside
        larger = CAMERA.fx_px / SOURCE_CAMERA.fx_px
        np.testing.assert_allclose(
            magnification[shown_by], ratio[shown_by] * larger / (2 if with_detail else 1), rtol=1e-5
        )
        assert (
            np.abs(frame[shown_by] - view[shown_by]).mean() < 0.5
        )  # of rounding, and of places to 256ths of a pixel
        assert np.abs(frame[shown_by] - view[shown_by]).max() < 1.5
    assert not covered[source_index == NO_INDEX].any()


@pytest.mark.parametrize("is_grey", [True, False])
def test_finer_sources_are_the_detail_of_coarser_images(is_grey: bool) -> None:
    rng = np.random.default_rng(1)
    fine_camera = SOURCE_CAMERA.resized(98, 72)
    pose = se3.exp(np.array([0.1, 0.0, 0.9, 0.02, 0.05, 0]))
    fine = image(rng, (72, 98), is_grey)
    view_camera = Intrinsics(30.0, 30.0, 19.5, 15.5, 40, 32)  # half as fine
    inverse_depth, source_index = np.full((32, 40), 0.4, np.float32), np.zeros((32, 40), np.int32)
    small = pinhole.resize(fine, (49, 36))
    one = ImageSampler.of([patches.Source(fine, fine_camera, np.eye(4))], view_camera)
    same = ImageSampler.of([patches.Source(small, SOURCE_CAMERA, np.eye(4), fine)], view_camera)
    for part, expected in zip(
        *(r.sample(inverse_depth, source_index, pose) for r in (one, same)), strict=True
    ):
        np.testing.assert_allclose(part.astype(float), expected.astype(float), atol=1)
    seen = [resampled(sampler.sources[0], view_camera).astype(float) for sampler in (one, same)]
    np.testing.assert_allclose(*seen, atol=1)


def test_what_was_observed_is_the_first_source_itself() -> None:
    seen = sources(np.random.default_rng(2), is_grey=False, with_detail=True)
    shown_by = resampled(seen[0], SOURCE_CAMERA.cropped(10, 5, 30, 20))
    np.testing.assert_array_equal(shown_by, seen[0].frame[5:25, 10:40])
    np.testing.assert_array_equal(resampled(seen[0], SOURCE_CAMERA), seen[0].frame)


def test_beside_what_was_observed_the_border_goes_on() -> None:
    seen = sources(np.random.default_rng(2), is_grey=True, with_detail=False)
    larger = SOURCE_CAMERA.cropped(-3, -2, 55, 40)
    framed = cv2.copyMakeBorder(seen[0].frame, 2, 2, 3, 3, cv2.BORDER_REPLICATE)
    np.testing.assert_array_equal(resampled(seen[0], larger), framed)


def test_none_of_many_images_reaches_into_another() -> None:
    images = ImageStack.of([np.full((20, 30, 3), 10 * n, np.uint8) for n in range(1, 8)])
    corners = np.array([[[-0.5, -0.5], [29.5, -0.5]], [[-0.5, 19.5], [29.5, 19.5]]], np.float32)
    for n in range(7):
        read = images.sample(corners, np.full((2, 2), n, np.int32), (1.0, 1.0))
        np.testing.assert_array_equal(read, 10 * (n + 1))


def test_grey_images_are_read_like_each_channel_of_colours() -> None:
    rng = np.random.default_rng(3)
    colours = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
    pixels, source_index = (
        rng.uniform(-0.5, 47.5, (20, 30, 2)).astype(np.float32),
        np.zeros((20, 30), np.int32),
    )
    whole = ImageStack.of([colours]).sample(pixels, source_index, (1.0, 1.0))
    assert whole.std(axis=-1).mean() > 10
    for channel in range(3):
        grey = ImageStack.of([np.repeat(colours[..., channel : channel + 1], 3, axis=-1)])
        assert grey.channels.shape[1] == 1
        read = grey.sample(pixels, source_index, (1.0, 1.0))
        np.testing.assert_array_equal(
            read, np.repeat(whole[..., channel : channel + 1], 3, axis=-1)
        )
