"""Colours of views against a smooth pattern that is known between pixels, too."""

import tracemalloc

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.rendering.image_sampler import ImageSampler
from geovp_classic.rendering.rasterizer import NO_INDEX
from geovp_classic.rendering.source import Source
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(40.0, 44.0, 19.5, 15.5, 40, 32)
SOURCE_CAMERA = Intrinsics(30.0, 30.0, 24.0, 17.5, 49, 36)


def pattern(number: int, u: FloatArray, v: FloatArray) -> FloatArray:
    """Return smooth colours [H, W, 3] at pixels of a source."""
    phases = np.array([0, 2, 4]) + number
    waves = np.sin(0.3 * u[..., None] + phases) * np.cos(0.25 * v[..., None])
    return 128 + 100 * waves


def test_each_pixel_is_what_its_source_shows() -> None:
    rng = np.random.default_rng(0)
    twists = np.array(
        [[0, 0, 0, 0, 0, 0], [0.3, 0.1, -0.4, 0.02, -0.1, 0.1], [-0.5, 0, 0.2, 0, 0.3, 0]]
    )
    v, u = np.indices((36, 49))
    sources = [
        Source(pattern(n, u, v).round().astype(np.uint8), SOURCE_CAMERA, se3.exp(twist))
        for n, twist in enumerate(twists)
    ]
    inverse_depth = rng.uniform(0, 0.6, (32, 40)).astype(np.float32)
    inverse_depth[:5] = 0
    source_index = rng.integers(NO_INDEX, 3, (32, 40)).astype(np.int32)
    pose = se3.exp(np.array([0.2, -0.1, 0.8, 0.05, 0.1, -0.02]))
    frame, covered, magnification = ImageSampler(sources, CAMERA).sample(
        inverse_depth, source_index, pose
    )
    assert 0.3 < covered.mean() < 0.8
    assert not covered[source_index == NO_INDEX].any()
    assert not frame[~covered].any()
    assert np.isinf(magnification[~covered]).all()
    for n, source in enumerate(sources):
        pixels, ratio = source.project(inverse_depth, pose, CAMERA)
        u, v = pixels[..., 0], pixels[..., 1]
        is_inside = (ratio > 0.001) & (u >= -0.5) & (v >= -0.5) & (u <= 48.5) & (v <= 35.5)
        is_own = source_index == n
        np.testing.assert_array_equal(covered[is_own], is_inside[is_own])
        shown = is_own & is_inside
        scale = CAMERA.fx_px / SOURCE_CAMERA.fx_px
        np.testing.assert_allclose(magnification[shown], ratio[shown] * scale, rtol=1e-5)
        inner = shown & (u > 3) & (v > 3) & (u < 45) & (v < 32)  # away from the border
        assert inner.sum() > 30
        difference = np.abs(frame[inner] - pattern(n, u, v)[inner])
        assert difference.mean() < 1.0  # OpenCV rounds to 32nds of a pixel
        assert difference.max() < 3.0


def test_magnification_decides_between_fine_and_coarse_images() -> None:
    # The image is twice as fine as the view, of a wall at 9, which shows all detail from half way
    # there. From a third of the way, at a magnification of 0.75, it shows half of it.
    camera = Intrinsics(30.0, 30.0, 24.0, 17.5, 49, 36)
    fine = np.random.default_rng(1).integers(0, 255, (72, 98, 3), dtype=np.uint8)
    source = Source(fine, SOURCE_CAMERA, np.eye(4))
    coarse = Source(pinhole.resize(fine, (49, 36)), SOURCE_CAMERA, np.eye(4))
    pose = se3.compose(np.eye(3), np.array([0, 0, 3.0]))
    inverse_depth = np.full((36, 49), 1 / 6, np.float32)
    index = np.zeros((36, 49), np.int32)
    frame, _, magnification = ImageSampler([source], camera).sample(inverse_depth, index, pose)
    np.testing.assert_allclose(magnification, 0.75, rtol=1e-4)
    pixels, _ = source.project(inverse_depth, pose, camera)
    both = [each.sample(pixels, index == 0) for each in (source, coarse)]
    assert np.abs(frame - np.clip(np.mean(both, axis=0), 0, 255)).max() < 1


def test_the_memory_of_a_sampled_image_is_bounded() -> None:
    frame = np.random.default_rng(3).integers(0, 255, (1080, 1920, 3), dtype=np.uint8)
    source = Source(frame, Intrinsics(1700.0, 1700.0, 959.5, 539.5, 1920, 1080), np.eye(4))
    tracemalloc.start()
    source.sample(np.full((8, 8, 2), 500, np.float32), np.ones((8, 8), bool))
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # Three times the height and the width, next to the frame with its margins: 62 MB in all.
    assert peak_bytes < 11 * frame.nbytes
