"""Textures: images, and sampling against a slow reference."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geovp_classic.data.synthetic.images import SIZE, noise_of, rgba
from geovp_classic.data.synthetic.textures import MAX_TAPS, Texture, mip_maps, sample
from geovp_classic.types import FloatArray


def level_of(texture: int, level: int) -> FloatArray:
    size = SIZE >> level
    return mip_maps()[texture, 2 * SIZE - 2 * size : 2 * SIZE - size, :size] / 255.0


def bilinear(image: FloatArray, u: float, v: float) -> FloatArray:
    size = len(image)
    x, y = u * size - 0.5, v * size - 0.5
    left, top = int(np.floor(x)), int(np.floor(y))
    value = np.zeros(4)
    for column, weight_x in ((left, left + 1 - x), (left + 1, x - left)):
        for row, weight_y in ((top, top + 1 - y), (top + 1, y - top)):
            value += weight_x * weight_y * image[row % size, column % size]
    return value


def slow_sample(texture: int, uv: FloatArray, right: FloatArray, down: FloatArray) -> FloatArray:
    """Return one pixel: taps along the longer step, two mip levels for the shorter one."""
    shorter, longer = sorted([right, down], key=np.linalg.norm)
    major, minor = SIZE * np.linalg.norm(longer), SIZE * np.linalg.norm(shorter)
    minor = max(minor, major / MAX_TAPS, 1.0)
    taps = min(max(int(np.ceil(major / minor)), 1), MAX_TAPS)
    fraction, low = np.modf(min(np.log2(minor), np.log2(SIZE)))
    value = np.zeros(4)
    for tap in range(taps):
        u, v = uv + ((tap + 0.5) / taps - 0.5) * longer
        value += (1 - fraction) * bilinear(level_of(texture, int(low)), u, v)
        if fraction > 0:
            value += fraction * bilinear(level_of(texture, int(low) + 1), u, v)
    return value / taps


@settings(max_examples=40, deadline=None)
@given(
    texture=st.sampled_from(list(Texture)),
    uv=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    size=st.floats(1e-4, 20.0),
    stretch=st.floats(0.02, 0.99),
    angle_rad=st.floats(0, 3.1),
)
def test_sampling_agrees_with_a_slow_reference(
    texture: Texture, uv: tuple[float, float], size: float, stretch: float, angle_rad: float
) -> None:
    right = size * np.array([np.cos(angle_rad), np.sin(angle_rad)])
    down = stretch * np.array([-right[1], right[0]])
    fast = sample(texture, np.array([uv]), np.array([[right, down]]))[0]
    np.testing.assert_allclose(fast, slow_sample(texture, np.array(uv), right, down), atol=4e-3)


def test_a_large_footprint_shows_the_mean() -> None:
    for texture in (Texture.GRASS, Texture.ROAD, Texture.LEAVES):
        mean = level_of(texture, 0).mean(axis=(0, 1))
        colour = sample(texture, np.array([[0.3, 0.8]]), 8 * np.eye(2)[None])[0]
        np.testing.assert_allclose(colour, mean, atol=0.02)


def test_the_minimum_size_smooths_a_texture() -> None:
    uv = np.random.default_rng(0).uniform(0, 1, (400, 2))
    steps = np.zeros((400, 2, 2))
    sharp, soft = (sample(Texture.BRICK, uv, steps, size)[:, 0].std() for size in (0.0, 0.3))
    assert soft < 0.3 * sharp


def test_textures_have_contrast_and_windows_and_cars_have_untinted_parts() -> None:
    for texture in Texture:
        assert level_of(texture, 0)[..., :3].std() > 0.005, texture.name
    for texture in (
        Texture.PLASTER_WINDOWS,
        Texture.BRICK_WINDOWS,
        Texture.CAR_SIDE,
        Texture.CAR_END,
    ):
        tinted = level_of(texture, 0)[..., 3]
        assert (tinted.min(), tinted.max()) == (0.0, 1.0)


@pytest.mark.parametrize(
    "texture", [Texture.ASPHALT, Texture.GRASS, Texture.LEAVES, Texture.BRICK, Texture.ROOF]
)
def test_repeating_textures_have_no_seam(texture: Texture) -> None:
    """Steps over the border are no larger than the largest steps inside, which are at joints."""
    image = level_of(texture, 0)[..., :3]
    for axis in (0, 1):
        inside = np.abs(np.diff(image, axis=axis)).mean(axis=(1 - axis, 2)).max()
        seam = np.abs(image.take(0, axis=axis) - image.take(-1, axis=axis)).mean()
        assert seam < 1.5 * inside


def test_noise_is_normalised_and_has_the_spectrum_of_its_slope() -> None:
    rng = np.random.default_rng(5)
    smooth, rough = noise_of(rng, 2.0), noise_of(rng, 0.0)
    for image in (smooth, rough):
        np.testing.assert_allclose([image.std(), image.mean()], [1.0, 0.0], atol=1e-5)
    assert np.abs(np.diff(smooth, axis=0)).mean() < 0.2 * np.abs(np.diff(rough, axis=0)).mean()
    spectrum = np.abs(np.fft.rfft2(noise_of(rng, 0.5, min_frequency=10.0)))
    assert spectrum[:5, :5].max() < 1e-2 * spectrum.max()


def test_rgba_rounds_and_clips() -> None:
    image = rgba(np.array([[0.5, 2.0]]), (1.0, 0.5, 0.0), 0.5)
    np.testing.assert_array_equal(image, [[[128, 64, 0, 128], [255, 255, 0, 128]]])
