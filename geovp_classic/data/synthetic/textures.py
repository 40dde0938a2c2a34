"""The textures of all surfaces, and their colour averaged over the footprint of a pixel."""

import enum
import functools
import math
from typing import Self

import cv2
import numba
import numpy as np

from geovp_classic.data.synthetic import images
from geovp_classic.data.synthetic.images import SIZE, Painter
from geovp_classic.types import ByteArray, FloatArray, IntArray

MAX_TAPS = 8  # along the longer side of a footprint


class Texture(enum.IntEnum):
    """Image, size and reflectance of each texture; its number is its place in the mip maps."""

    PLAIN = images.plain, 2.0
    ASPHALT = images.asphalt, 6.0, 0.28
    ROAD = images.road, 18.0, 0.28
    ZEBRA = images.zebra, 6.0, 0.28
    PAVEMENT = images.pavement, 4.0, 0.14
    GRASS = images.grass, 6.0, 0.28
    PLASTER = images.plaster, 5.6, 0.14
    BRICK = images.brick, 5.6, 0.14
    PLASTER_WINDOWS = images.plaster_windows, 5.6, 0.14, 0.35
    BRICK_WINDOWS = images.brick_windows, 5.6, 0.14, 0.35
    ROOF = images.roof, 4.0, 0.28
    LEAVES = images.leaves, 3.0
    CAR_SIDE = images.car_side, 1.0, 0.0, 0.35
    CAR_END = images.car_end, 1.0, 0.0, 0.1
    CAR_WINDOW = images.car_window, 1.0, 0.0, 0.5
    CLOUDS = images.clouds, 1.0
    STAINS = images.stains, 37.0

    paint: Painter
    tile_m: float  # size of the image; 1 for images that cover a surface once
    stains: float  # relative amplitude of large stains, which hide the repetition
    gloss: float  # fraction of the sky light that untinted parts reflect

    def __new__(
        cls, paint: Painter, tile_m: float, stains: float = 0.0, gloss: float = 0.0
    ) -> Self:
        """Create the next texture; numbers start at 0."""
        number = len(cls.__members__)
        texture = int.__new__(cls, number)
        texture._value_ = number
        texture.paint = paint
        texture.tile_m = tile_m
        texture.stains = stains
        texture.gloss = gloss
        return texture


TILE_M = np.array([texture.tile_m for texture in Texture])


@functools.lru_cache(maxsize=1)
def mip_maps() -> ByteArray:
    """Paint all textures; return RGBA [textures, 2 SIZE, SIZE, 4] in display brightness.

    Level k of a texture starts at row 2 SIZE - (2 SIZE >> k).
    """
    stack = np.zeros((len(Texture), 2 * SIZE, SIZE, 4), dtype=np.uint8)
    for texture in Texture:
        # All streets share the images; they differ by tints and layout.
        image = texture.paint(np.random.default_rng([20_110_926, texture]))
        for level in range(SIZE.bit_length()):
            size = SIZE >> level
            first = 2 * SIZE - 2 * size
            resized = cv2.resize(image, (size, size), interpolation=cv2.INTER_AREA)
            stack[texture, first : first + size, :size] = resized
    return stack


def sample(
    texture: IntArray | Texture,  # [N] or one for all
    uv: FloatArray,  # [N, 2], in tiles; images repeat
    uv_steps: FloatArray,  # [N, 2, 2], change of uv to the next pixel to the right and below
    min_size: FloatArray | float = 0.0,  # [N], in tiles; smaller details are not resolved
) -> FloatArray:
    """Return RGBA [N, 4] in 0..1, averaged over the footprint of each pixel."""
    textures = np.zeros(len(uv), dtype=int) + texture
    min_sizes = np.zeros(len(uv)) + min_size
    return _sample(mip_maps(), textures, np.ascontiguousarray(uv), uv_steps, min_sizes)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sample(stack, texture, uv, uv_steps, min_size):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Average taps along the longer side of the footprint in two mip levels."""
    size = stack.shape[2]
    colours = np.zeros((len(texture), 4))
    for i in range(len(texture)):
        image = stack[texture[i]]
        right = math.hypot(uv_steps[i, 0, 0], uv_steps[i, 0, 1]) * size
        down = math.hypot(uv_steps[i, 1, 0], uv_steps[i, 1, 1]) * size
        longer = 0 if right > down else 1
        major = max(right, down)
        minor = max(min(right, down), major / MAX_TAPS, min_size[i] * size, 1.0)
        num_taps = min(max(math.ceil(major / minor), 1), MAX_TAPS)
        level = min(math.log2(minor), math.log2(size))
        for step in range(2):
            mip = int(level) + step
            mip_weight = 1.0 - abs(level - mip)
            if mip_weight == 0.0:
                continue
            width = size >> mip
            first = 2 * size - 2 * width
            for tap in range(num_taps):
                offset = (tap + 0.5) / num_taps - 0.5
                x = (uv[i, 0] + offset * uv_steps[i, longer, 0]) * width - 0.5
                y = (uv[i, 1] + offset * uv_steps[i, longer, 1]) * width - 0.5
                left = math.floor(x)
                top = math.floor(y)
                for row in (top, top + 1):
                    for column in (left, left + 1):
                        weight = mip_weight * (1.0 - abs(x - column)) * (1.0 - abs(y - row))
                        texel = image[first + row % width, column % width]
                        for channel in range(4):
                            colours[i, channel] += weight * texel[channel] / (255.0 * num_taps)
    return colours
