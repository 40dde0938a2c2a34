"""How bright a surface is where a ray hits it: textures filtered over the pixel's footprint, sun,
sky and haze.

Light is linear; an image's byte is the square root of it (gamma 2).
"""

import functools
import math
from dataclasses import dataclass

import cv2
import numba
import numpy as np

from geovp_classic.data.synthetic import images
from geovp_classic.data.synthetic.images import SIZE, TILE_M, IntArray, Texture
from geovp_classic.data.synthetic.mesh import Hits
from geovp_classic.types import BoolArray, ByteArray, FloatArray

SEED = 20_110_926  # one set of images for all streets; streets differ by tints and layout
MAX_TAPS = 8  # along the longer side of a footprint
STAINED = np.zeros(len(Texture), dtype=np.float32)  # how much large stains show on a texture
STAINED[
    [
        Texture.PLASTER,
        Texture.BRICK,
        Texture.PLASTER_WINDOWS,
        Texture.BRICK_WINDOWS,
        Texture.PAVEMENT,
    ]
] = 0.14
STAINED[[Texture.ASPHALT, Texture.ROAD, Texture.ZEBRA, Texture.GRASS, Texture.ROOF]] = 0.28
GLOSS = np.zeros(
    len(Texture), dtype=np.float32
)  # how much of the sky the untinted parts of a texture mirror
GLOSS[[Texture.PLASTER_WINDOWS, Texture.BRICK_WINDOWS, Texture.CAR_WINDOW]] = 0.35, 0.35, 0.5
GLOSS[[Texture.CAR_PAINT, Texture.CAR_SIDE, Texture.CAR_END]] = 0.4, 0.3, 0.1
AMBIENT, ZENITH, HORIZON = np.array(
    [(0.36, 0.42, 0.52), (0.16, 0.33, 0.66), (0.62, 0.74, 0.86)], dtype=np.float32
)
TINTED_GLOSS = 0.3  # of that, on the tinted parts


@dataclass(frozen=True)
class Weather:
    """Where the sun is, how bright it is, and where the clouds are; all float32."""

    to_sun: FloatArray  # [3], unit, world frame
    sun: FloatArray  # [3], linear light
    cloud_shift: FloatArray  # [2]


@dataclass(frozen=True)
class Optics:
    """What lies between street and sensor; with neither haze nor gloss surfaces look the same from
    everywhere.
    """

    haze_per_m: float = 0.0012
    gloss: float = 1.0  # scales what glass and paint mirror
    blur_px: float = 0.45  # spread of the lens; more than 0.7 makes images that survive resampling
    finest_detail_m: float = 0.0  # textures are smoothed to this size


def shade(
    hits: Hits, eye: FloatArray, lit: BoolArray, weather: Weather, optics: Optics
) -> FloatArray:
    """Light [N, 3] that comes from N hits to the eye [3]; the sun reaches those that
    are lit [N].
    """
    sight = hits.points - eye.astype(np.float32)
    distance = np.linalg.norm(sight, axis=-1, keepdims=True)
    finest = (optics.finest_detail_m / TILE_M).astype(np.float32)[hits.texture]
    texel = sample(hits.texture, hits.uv, hits.uv_steps, finest)
    colour, tinted = texel[:, :3], texel[:, 3:]
    colour = colour * (1 + tinted * (hits.tint - 1))
    stained = np.nonzero(STAINED[hits.texture])[0]
    colour[stained] *= 1 + STAINED[hits.texture[stained], None] * _stains(hits, stained)
    cosine = hits.normal @ weather.to_sun
    through = hits.ambient * (0.25 + 0.5 * np.abs(cosine))  # leaves let light through
    direct = np.where(hits.texture == Texture.LEAVES, through, np.maximum(cosine, 0.0)) * lit
    above = hits.ambient * (0.75 - 0.25 * hits.normal[:, 1])
    light = colour**2 * (direct[:, None] * weather.sun + above[:, None] * AMBIENT)
    glossy = np.nonzero(GLOSS[hits.texture] * optics.gloss)[0]
    share = (
        optics.gloss * GLOSS[hits.texture[glossy], None] * (1 - (1 - TINTED_GLOSS) * tinted[glossy])
    )
    normal, ray = hits.normal[glossy], (sight / distance)[glossy]
    facing = -np.einsum("nj,nj->n", normal, ray)[:, None]
    share *= 0.25 + 0.75 * (1 - np.clip(facing, 0, 1)) ** 5  # more at grazing angles (Schlick 1994)
    light[glossy] += share * (sky_light(weather, ray + 2 * facing * normal) - light[glossy])
    clear = np.exp(np.float32(-optics.haze_per_m) * distance)
    return light * clear + HORIZON * (1 - clear)


def sky_light(weather: Weather, directions: FloatArray) -> FloatArray:
    """Light [N, 3] from unit directions [N, 3]: paler at the horizon, clouds on a ceiling, a glow
    around the sun.
    """
    up = np.maximum(-directions[:, 1:2], 0.0)
    fade = np.exp(-4.0 * up)
    reach = 0.35 / (up + 0.12)
    spread = 0.004 * reach[:, :, None] ** 2 * np.eye(2, dtype=np.float32)
    place = directions[:, [0, 2]] * reach + weather.cloud_shift
    clouds = sample(np.full(len(up), int(Texture.CLOUDS)), place, spread)
    cover = clouds[:, 3:] * np.minimum(1.0, 5.0 * up)  # none in the haze
    glow = np.maximum(directions @ weather.to_sun, 0.0)[:, None] ** 24 * np.float32(0.35)
    clear = HORIZON * fade + ZENITH * (1 - fade)
    return clear * (1 - cover) + cover * clouds[:, :3] + glow * weather.sun


def _stains(hits: Hits, where: IntArray) -> FloatArray:
    """Large soft stains [K, 1], -1 to 1, that hide the repetition of the textures."""
    tile_m = np.float32(TILE_M[Texture.STAINS])
    x, y, z = hits.points[where].T
    flat = np.abs(hits.normal[where, 1]) > 0.5
    place = (
        np.stack([np.where(flat, x, x + np.float32(0.7) * z), np.where(flat, z, y)], axis=-1)
        / tile_m
    )
    steps = (np.minimum(hits.sizes_m[where], 8.0) / tile_m)[:, :, None] * np.eye(
        2, dtype=np.float32
    )
    return 2 * sample(np.full(len(where), int(Texture.STAINS)), place, steps)[:, :1] - 1


@functools.lru_cache(maxsize=1)
def mip_maps() -> ByteArray:
    """RGBA of all textures [textures, 2 SIZE, SIZE, 4] in display brightness; level k at 2 SIZE -
    (2 SIZE >> k).
    """
    stack = np.zeros((len(Texture), 2 * SIZE, SIZE, 4), dtype=np.uint8)
    for texture in Texture:
        image = getattr(images, texture.name.lower())(np.random.default_rng([SEED, texture]))
        for size in (SIZE >> level for level in range(SIZE.bit_length())):
            first = 2 * SIZE - 2 * size
            stack[texture, first : first + size, :size] = cv2.resize(
                image, (size, size), interpolation=cv2.INTER_AREA
            )
    return stack


def sample(
    texture: IntArray, uv: FloatArray, uv_steps: FloatArray, finest: FloatArray | float = 0.0
) -> FloatArray:
    """RGBA [N, 4] float32 in 0..1, averaged over each pixel's footprint.

    `uv` [N, 2] is in tiles, the images repeat; `uv_steps` [N, 2, 2] are its changes to the next
    pixel right and down. Nothing smaller than `finest` [N], in tiles, is resolved.
    """
    out = np.zeros((len(texture), 4), dtype=np.float32)
    smallest = np.broadcast_to(finest, len(texture))
    uv, uv_steps, smallest = (
        np.ascontiguousarray(values, dtype=np.float32) for values in (uv, uv_steps, smallest)
    )
    _sample(mip_maps(), np.ascontiguousarray(texture, dtype=np.int64), uv, uv_steps, smallest, out)
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sample(stack, texture, uv, uv_steps, finest, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    size = stack.shape[2]
    for i in range(len(texture)):
        image = stack[texture[i]]
        right = math.hypot(uv_steps[i, 0, 0], uv_steps[i, 0, 1]) * size
        down = math.hypot(uv_steps[i, 1, 0], uv_steps[i, 1, 1]) * size
        longer = 0 if right > down else 1
        minor = max(min(right, down), max(right, down) / MAX_TAPS, finest[i] * size, 1.0)
        taps = min(max(math.ceil(max(right, down) / minor), 1), MAX_TAPS)
        level = min(math.log2(minor), math.log2(size))
        low = int(level)
        for upper in range(2):  # two mip levels, mixed
            share = (level - low if upper else 1.0 - (level - low)) / (255.0 * taps)
            if share == 0.0:
                continue
            width, first = size >> (low + upper), 2 * size - (2 * size >> (low + upper))
            for tap in range(taps):
                place = (tap + 0.5) / taps - 0.5
                x = (uv[i, 0] + place * uv_steps[i, longer, 0]) * width - 0.5
                y = (uv[i, 1] + place * uv_steps[i, longer, 1]) * width - 0.5
                column, row = math.floor(x), math.floor(y)
                fx, fy = x - column, y - row
                for corner in range(4):
                    v = first + ((row + (corner >> 1)) & (width - 1))  # sizes are powers of two
                    u = (column + (corner & 1)) & (width - 1)
                    weight = (
                        share * (fx if corner & 1 else 1.0 - fx) * (fy if corner >> 1 else 1.0 - fy)
                    )
                    for channel in range(4):
                        out[i, channel] += weight * image[v, u, channel]
