"""All images for surfaces by name, with their sizes and mip-maps; painted once per process."""

from __future__ import annotations

import enum
import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from geovp_classic.data.synthetic import frames, patterns
from geovp_classic.types import ByteArray

IntArray = npt.NDArray[np.integer[Any]]
ATLAS_SEED = 20_110_926  # one set of images for all streets; streets differ by tints and layout


class Texture(enum.IntEnum):
    """Every image there is; the number is its place in the atlas."""

    PLAIN = 0
    ASPHALT = 1
    ROAD_PAINT = 2
    PAVEMENT = 3
    KERB = 4
    GRASS = 5
    PLASTER = 6
    BRICK = 7
    ROOF = 8
    BARK = 9
    LEAVES = 10
    WINDOW_PLAIN = 11
    WINDOW_CURTAIN = 12
    WINDOW_CROSS = 13
    DOOR = 14
    GARAGE = 15
    ZEBRA = 16
    WHEEL = 17
    CAR_GLASS = 18
    SIGN_RING = 19
    SIGN_BLUE = 20
    CLOUDS = 21
    MACRO = 22
    WOODS = 23
    CAR_SIDE = 24
    FENCE = 25


TILE_M: dict[Texture, float] = {
    Texture.PLAIN: 2.0,
    Texture.ASPHALT: 6.0,
    Texture.ROAD_PAINT: 27.0,
    Texture.PAVEMENT: 4.0,
    Texture.KERB: 2.0,
    Texture.GRASS: 6.0,
    Texture.PLASTER: 6.0,
    Texture.BRICK: 3.0,
    Texture.ROOF: 4.0,
    Texture.BARK: 1.5,
    Texture.LEAVES: 3.0,
    Texture.MACRO: 37.0,
    Texture.WOODS: 60.0,
    Texture.FENCE: 2.0,
    Texture.ZEBRA: 6.0,
} | dict.fromkeys(
    (
        Texture.WINDOW_PLAIN,
        Texture.WINDOW_CURTAIN,
        Texture.WINDOW_CROSS,
        Texture.DOOR,
        Texture.GARAGE,
        Texture.WHEEL,
        Texture.CAR_GLASS,
        Texture.SIGN_RING,
        Texture.SIGN_BLUE,
        Texture.CLOUDS,
        Texture.CAR_SIDE,
    ),
    1.0,
)


@dataclass(frozen=True)
class Atlas:
    """All images with all mip levels in one row of texels; sizes are powers of two."""

    texels: ByteArray  # [L, 4], RGBA in display brightness, colours times alpha
    starts: IntArray  # [textures, levels], the first texel
    widths: IntArray  # [textures, levels]; 0 behind the last level
    heights: IntArray  # [textures, levels]


@functools.lru_cache(maxsize=1)
def atlas() -> Atlas:
    """The atlas of all textures."""
    chains = [_mip_levels(PAINTERS[texture](np.random.default_rng([ATLAS_SEED, texture]))) for texture in Texture]
    num_levels = max(map(len, chains))
    starts, widths, heights = (np.zeros((len(chains), num_levels), dtype=np.int64) for _ in range(3))
    place = 0
    for row, chain in enumerate(chains):
        for level, image in enumerate(chain):
            heights[row, level], widths[row, level] = image.shape[:2]
            starts[row, level] = place
            place += image.shape[0] * image.shape[1]
    return Atlas(np.concatenate([level.reshape(-1, 4) for chain in chains for level in chain]), starts, widths, heights)


def _mip_levels(image: ByteArray) -> list[ByteArray]:
    levels = [image]
    while max(levels[-1].shape[:2]) > 1:
        height, width = levels[-1].shape[:2]
        size = (max(1, width // 2), max(1, height // 2))
        smaller = cv2.resize(levels[-1], size, interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(smaller, dtype=np.uint8).reshape(size[1], size[0], 4))
    return levels


PAINTERS: dict[Texture, Callable[[np.random.Generator], ByteArray]] = {
    Texture.PLAIN: patterns.plain,
    Texture.ASPHALT: patterns.asphalt,
    Texture.ROAD_PAINT: patterns.road_paint,
    Texture.PAVEMENT: patterns.pavement,
    Texture.KERB: patterns.kerb,
    Texture.GRASS: patterns.grass,
    Texture.PLASTER: patterns.plaster,
    Texture.BRICK: patterns.brick,
    Texture.ROOF: patterns.roof,
    Texture.BARK: patterns.bark,
    Texture.LEAVES: patterns.leaves,
    Texture.WINDOW_PLAIN: functools.partial(frames.window, bars=(1, 1), curtain=True),
    Texture.WINDOW_CURTAIN: functools.partial(frames.window, bars=(2, 1), curtain=True),
    Texture.WINDOW_CROSS: functools.partial(frames.window, bars=(2, 3), curtain=False),
    Texture.DOOR: frames.door,
    Texture.GARAGE: frames.garage,
    Texture.ZEBRA: patterns.zebra,
    Texture.WHEEL: frames.wheel,
    Texture.CAR_GLASS: frames.car_glass,
    Texture.SIGN_RING: frames.sign_ring,
    Texture.SIGN_BLUE: frames.sign_blue,
    Texture.CLOUDS: frames.clouds,
    Texture.MACRO: patterns.macro,
    Texture.WOODS: patterns.woods,
    Texture.CAR_SIDE: frames.car_side,
    Texture.FENCE: patterns.fence,
}
