"""Textures and how they are looked up, against a slow twin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geovp_classic.data.synthetic.images import SIZE, Texture, noise, rgba
from geovp_classic.data.synthetic.shading import MAX_TAPS, mip_maps, sample


def _level(texture: int, level: int) -> np.ndarray:
    size = SIZE >> level
    return mip_maps()[texture, 2 * SIZE - 2 * size : 2 * SIZE - size, :size] / 255.0


def _bilinear(image: np.ndarray, u: float, v: float) -> np.ndarray:
    height, width = image.shape[:2]
    x, y = u * width - 0.5, v * height - 0.5
    column, row = int(np.floor(x)), int(np.floor(y))
    value = np.zeros(4)
    for dx, wx in ((0, 1 - (x - column)), (1, x - column)):
        for dy, wy in ((0, 1 - (y - row)), (1, y - row)):
            value += wx * wy * image[(row + dy) % height, (column + dx) % width]
    return value


def slow_sample(texture: int, uv: np.ndarray, step_x: np.ndarray, step_y: np.ndarray) -> np.ndarray:
    """One pixel, as one would explain it: taps along the longer side, two mip levels that fit the
    shorter one.
    """
    longer, shorter = sorted([step_x, step_y], key=lambda step: -np.hypot(*step))
    major, minor = (float(np.hypot(*step)) * SIZE for step in (longer, shorter))
    minor = max(minor, major / MAX_TAPS, 1.0)
    taps = min(max(int(np.ceil(major / minor)), 1), MAX_TAPS)
    level = min(np.log2(minor), np.log2(SIZE))
    low, part = int(level), level - int(level)
    value = np.zeros(4)
    for tap in range(taps):
        u, v = uv + ((tap + 0.5) / taps - 0.5) * longer
        value += (1 - part) * _bilinear(_level(texture, low), u, v)
        if part > 0:
            value += part * _bilinear(_level(texture, low + 1), u, v)
    return value / taps


@settings(max_examples=40, deadline=None)
@given(
    texture=st.sampled_from(list(Texture)),
    uv=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    size=st.floats(1e-4, 20.0),
    stretch=st.floats(0.02, 1.0),
    angle_rad=st.floats(0, 3.1),
)
def test_sampling_equals_its_slow_twin(
    texture: Texture, uv: tuple[float, float], size: float, stretch: float, angle_rad: float
) -> None:
    place = np.array(uv, dtype=np.float32)
    step_x = np.array([np.cos(angle_rad), np.sin(angle_rad)], dtype=np.float32) * np.float32(size)
    step_y = np.array([-step_x[1], step_x[0]]) * np.float32(stretch)
    fast = sample(np.array([texture]), place[None], np.stack([step_x, step_y])[None])[0]
    np.testing.assert_allclose(fast, slow_sample(texture, place, step_x, step_y), atol=4e-3)


def test_a_texel_in_its_middle_is_itself() -> None:
    image = _level(Texture.BRICK, 0)
    height, width = image.shape[:2]
    uv, still = np.array([[(7 + 0.5) / width, (11 + 0.5) / height]]), np.zeros((1, 2, 2))
    np.testing.assert_allclose(
        sample(np.array([Texture.BRICK]), uv, still)[0], image[11, 7], atol=1e-4
    )


def test_a_pixel_as_large_as_the_tile_sees_its_mean() -> None:
    for texture in (Texture.GRASS, Texture.ROAD, Texture.LEAVES):
        mean = _level(texture, 0).mean(axis=(0, 1))
        seen = sample(np.array([texture]), np.array([[0.3, 0.8]]), 8 * np.eye(2)[None])[0]
        np.testing.assert_allclose(seen, mean, atol=0.02)


def test_finest_smooths_a_texture_away() -> None:
    places = np.random.default_rng(0).uniform(0, 1, (400, 2))
    still, which = np.zeros((400, 2, 2)), np.full(400, int(Texture.BRICK))
    sharp, soft = (sample(which, places, still, finest)[:, 0].std() for finest in (0.0, 0.3))
    assert soft < 0.3 * sharp


def test_every_texture_has_an_image_with_contrast_in_it() -> None:
    for texture in Texture:
        assert _level(texture, 0)[..., :3].std() > 0.005, texture.name


def test_glass_lamps_and_bumpers_are_not_tinted_and_paint_is() -> None:
    for texture in (
        Texture.PLASTER_WINDOWS,
        Texture.BRICK_WINDOWS,
        Texture.CAR_SIDE,
        Texture.CAR_END,
    ):
        tinted = _level(texture, 0)[..., 3]
        assert tinted.min() == 0.0
        assert tinted.max() == 1.0


@pytest.mark.parametrize(
    "texture", [Texture.ASPHALT, Texture.GRASS, Texture.LEAVES, Texture.BRICK, Texture.ROOF]
)
def test_repeating_textures_have_no_seam(texture: Texture) -> None:
    """The step over the border is no larger than steps inside (the largest are at joints)."""
    image = _level(texture, 0)[..., :3]
    for axis in (0, 1):
        inside = np.abs(np.diff(image, axis=axis)).mean(axis=(1 - axis, 2)).max()
        seam = np.abs(image.take(0, axis=axis) - image.take(-1, axis=axis)).mean()
        assert seam < 1.5 * inside


def test_noise_is_normalised_tileable_and_coloured() -> None:
    rng = np.random.default_rng(5)
    smooth, rough = noise(rng, 2.0), noise(rng, 0.0)
    for field in (smooth, rough):
        assert field.std() == pytest.approx(1.0, abs=1e-5)
        assert field.mean() == pytest.approx(0.0, abs=1e-5)
    assert np.abs(np.diff(smooth, axis=0)).mean() < 0.2 * np.abs(np.diff(rough, axis=0)).mean()
    spectrum = np.abs(np.fft.rfft2(noise(rng, 0.5, coarsest=10.0)))
    assert spectrum[:5, :5].max() < 1e-2 * spectrum.max()


def test_rgba_rounds_and_clips() -> None:
    image = rgba(np.array([[0.5, 2.0]]), (1.0, 0.5, 0.0), 0.5)
    np.testing.assert_array_equal(image, [[[128, 64, 0, 128], [255, 255, 0, 128]]])
