"""The textures of textures.toml, and their colour averaged over the footprint of a pixel."""

import enum
import functools
import math
import tomllib
from pathlib import Path

import cv2
import numba
import numpy as np

from geovp_classic.data.synthetic import images
from geovp_classic.data.synthetic.images import SIZE
from geovp_classic.types import ByteArray, FloatArray, IntArray

MAX_TAPS = 8  # along the longer side of a footprint


Texture = enum.IntEnum(
    "Texture",
    "PLAIN ASPHALT ROAD ZEBRA PAVEMENT GRASS PLASTER BRICK PLASTER_WINDOWS BRICK_WINDOWS ROOF "
    "LEAVES CAR_SIDE CAR_END CAR_WINDOW CLOUDS STAINS",
    start=0,
)
TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())
TILE_M = np.array([table.get("tile_m", 1.0) for table in TABLES.values()])


@functools.lru_cache(maxsize=1)
def mip_maps() -> ByteArray:
    """Paint all textures; return RGBA [textures, 2 SIZE, SIZE, 4] in display brightness.

    Level k of a texture starts at row 2 SIZE - (2 SIZE >> k).
    """
    stack = np.zeros((len(Texture), 2 * SIZE, SIZE, 4), dtype=np.uint8)
    for number, (name, table) in enumerate(TABLES.items()):
        # All streets share the images; they differ by tints and layout.
        image = images.paint(
            name, table, np.random.default_rng([20_110_926, number])
        )
        for level in range(SIZE.bit_length()):
            size = SIZE >> level
            first = 2 * SIZE - 2 * size
            resized = cv2.resize(
                image, (size, size), interpolation=cv2.INTER_AREA
            )
            stack[number, first : first + size, :size] = resized
    return stack


def sample(
    texture: IntArray | Texture,  # [N] or one for all
    uv: FloatArray,  # [N, 2], in tiles; images repeat
    uv_steps: FloatArray,  # [N, 2, 2], change of uv to the next pixel to the right and below
    min_size: FloatArray
    | float = 0.0,  # [N], in tiles; smaller details are not resolved
) -> FloatArray:
    """Return RGBA [N, 4] in 0..1, averaged over the footprint of each pixel."""
    textures = np.zeros(len(uv), dtype=int) + texture
    min_sizes = np.zeros(len(uv)) + min_size
    return _sample(
        mip_maps(), textures, np.ascontiguousarray(uv), uv_steps, min_sizes
    )


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
                        weight = (
                            mip_weight
                            * (1.0 - abs(x - column))
                            * (1.0 - abs(y - row))
                        )
                        texel = image[first + row % width, column % width]
                        for channel in range(4):
                            colours[i, channel] += (
                                weight * texel[channel] / (255.0 * num_taps)
                            )
    return colours
