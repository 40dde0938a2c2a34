"""How bright a surface is where a ray meets it: textures filtered over the pixel's footprint, sun, sky light and haze.

Light is linear; an image's byte is the square root of it (gamma 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.data.synthetic.sampling import sample
from geovp_classic.data.synthetic.surfaces import Patches
from geovp_classic.data.synthetic.textures import TILE_M, Atlas, Texture
from geovp_classic.types import BoolArray, FloatArray

TILES_M = np.array([TILE_M[texture] for texture in Texture])
BLOTCHES = np.zeros(len(Texture), dtype=np.float32)  # how much large stains show on a texture
BLOTCHES[[Texture.ASPHALT, Texture.GRASS, Texture.WOODS]] = 0.28
BLOTCHES[[Texture.PAVEMENT, Texture.PLASTER, Texture.BRICK, Texture.ROOF]] = 0.14


@dataclass(frozen=True)
class Weather:
    """Where the sun stands, how bright sun and sky are, and the air between."""

    to_sun: FloatArray  # [3], unit, world frame
    sun: FloatArray  # [3], linear light
    sky: FloatArray  # [3], light from all around
    zenith: FloatArray  # [3], colour overhead
    horizon: FloatArray  # [3], colour far away
    cloud_shift: FloatArray  # [2]


@dataclass(frozen=True)
class Optics:
    """What lies between the street and the sensor; with neither haze nor gloss it looks the same from everywhere."""

    haze_per_m: float = 0.0012  # how quickly far things fade
    gloss: float = 1.0  # scales what glass and paint mirror
    blur_px: float = 0.45  # spread of the lens; more than 0.7 makes images that survive resampling
    finest_detail_m: float = 0.0  # smooths textures to this size


def shade(
    atlas: Atlas,
    seen: Patches,  # N
    eye: FloatArray,  # [3]
    lit: BoolArray,  # [N], whether the sun gets there
    weather: Weather,
    optics: Optics,
) -> FloatArray:
    """Light [N, 3] that comes from surfaces to the eye."""
    sight = seen.points - eye.astype(np.float32)
    distance = np.sqrt(dot(sight, sight))
    diffuse = _albedo(atlas, seen, optics.finest_detail_m) * _incoming(weather, seen, lit)
    colour = _mirrored(atlas, weather, diffuse, seen, sight / distance, optics.gloss)
    clear = np.exp(np.float32(-optics.haze_per_m) * distance)
    return colour * clear + _light(weather.horizon) * (1 - clear)


def sky_light(
    atlas: Atlas,
    weather: Weather,
    directions: FloatArray,  # [N, 3], unit
) -> FloatArray:
    """Light [N, 3] of the sky: brighter towards the horizon, clouds on a ceiling, a glow around the sun."""
    up = np.maximum(-directions[:, 1:2], 0.0)
    fade = np.exp(-4.0 * up)
    clear = _light(weather.horizon) * fade + _light(weather.zenith) * (1 - fade)
    reach = 0.35 / (up + 0.12)
    spread = 0.004 * reach[:, :, None] ** 2 * np.eye(2, dtype=np.float32)
    place = directions[:, [0, 2]] * reach + weather.cloud_shift
    clouds = sample(atlas, np.full(len(up), int(Texture.CLOUDS)), place, spread)
    clouds *= np.minimum(1.0, 5.0 * up)  # none in the haze
    glow = np.maximum(directions @ _light(weather.to_sun), 0.0)[:, None] ** 24 * np.float32(0.35)
    return clear * (1 - clouds[:, 3:]) + np.float32(0.93) * clouds[:, :3] + glow * _light(weather.sun)


def _albedo(atlas: Atlas, seen: Patches, finest_m: float) -> FloatArray:
    """Linear reflectance [N, 3]: the texture times the tint, stained, with the paint over it."""
    finest = (finest_m / TILES_M).astype(np.float32)
    colour = sample(atlas, seen.texture, seen.uv, seen.uv_steps, finest[seen.texture])[:, :3] * seen.tint
    rough = np.nonzero(BLOTCHES[seen.texture] > 0)[0]
    stains = _blotches(atlas, seen.normal[rough], seen.points[rough], seen.sizes_m[rough])
    colour[rough] *= 1 + BLOTCHES[seen.texture[rough], None] * stains
    painted = np.nonzero(seen.paint >= 0)[0]
    paint = seen.paint[painted]
    coat = sample(atlas, paint, seen.paint_uv[painted], seen.paint_steps[painted], finest[paint])
    colour[painted] = colour[painted] * (1 - coat[:, 3:]) + coat[:, :3]
    return colour**2


def _blotches(atlas: Atlas, normal: FloatArray, points: FloatArray, sizes_m: FloatArray) -> FloatArray:
    """Large soft stains [N, 1], -1 to 1, that hide the repetition of the textures."""
    tile_m = np.float32(TILE_M[Texture.MACRO])
    flat = np.abs(normal[:, 1]) > 0.5
    x, y, z = points.T
    place = np.stack([np.where(flat, x, x + np.float32(0.7) * z), np.where(flat, z, y)], axis=-1) / tile_m
    steps = (np.minimum(sizes_m, 8.0) / tile_m)[:, :, None] * np.eye(2, dtype=np.float32)
    return 2 * sample(atlas, np.full(len(points), int(Texture.MACRO)), place, steps)[:, :1] - 1


def _incoming(weather: Weather, seen: Patches, lit: BoolArray) -> FloatArray:
    """Light [N, 3] that falls on the surfaces; leaves let it through."""
    toward = seen.normal @ _light(weather.to_sun)
    leaves = seen.texture == Texture.LEAVES
    direct = np.where(leaves, seen.around * (0.25 + 0.5 * np.abs(toward)), np.maximum(toward, 0.0)) * lit
    above = seen.around * (0.75 - 0.25 * seen.normal[:, 1])
    return direct[:, None] * _light(weather.sun) + above[:, None] * _light(weather.sky)


def _mirrored(
    atlas: Atlas, weather: Weather, colour: FloatArray, seen: Patches, sight: FloatArray, gloss: float
) -> FloatArray:
    """Colours [N, 3] with the sky mixed in that glass and paint mirror, more so at grazing angles (Schlick 1994)."""
    shiny = np.nonzero(seen.gloss > 0)[0]
    normal, ray = seen.normal[shiny], sight[shiny]
    cosine = -dot(normal, ray)
    share = np.float32(gloss) * seen.gloss[shiny, None] * (0.25 + 0.75 * (1 - np.clip(cosine, 0, 1)) ** 5)
    sky = sky_light(atlas, weather, ray + 2 * cosine * normal)
    colour = colour.copy()
    colour[shiny] += (sky - colour[shiny]) * share
    return colour


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Inner products [N, 1]."""
    return np.einsum("ni,ni->n", a, b)[:, None]


def _light(colour: FloatArray) -> FloatArray:
    """The same numbers in single precision, so that arrays they meet stay there."""
    return colour.astype(np.float32)
