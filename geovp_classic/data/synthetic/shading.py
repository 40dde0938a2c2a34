"""Light of surfaces and sky: textures, sun, sky light, gloss and haze.

Light is linear; the byte of an image is its square root (gamma 2).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geovp_classic.data.synthetic import textures
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.types import BoolArray, FloatArray, IntArray

Rgb = tuple[float, float, float]
STAINS = textures.column("stains", 0.0)
GLOSS = textures.column("gloss", 0.0)


class Hits(NamedTuple):
    """Surface points that rays from the eye hit."""

    points: FloatArray  # [N, 3]
    normal: FloatArray  # [N, 3], towards the eye
    texture: IntArray  # [N]
    tint: FloatArray  # [N, 3]
    uv: FloatArray  # [N, 2], place on the texture in tiles
    uv_axes: FloatArray  # [N, 2, 3], change of uv by a step in the world
    pixel_m: FloatArray  # [N], width of a pixel at this distance


@dataclass(frozen=True)
class Weather:
    """Sun and sky of a fine day; colours are linear light."""

    to_sun: FloatArray  # [3], unit, world frame
    sun: FloatArray  # [3]
    cloud_shift: FloatArray  # [2], in tiles
    ambient: Rgb = (0.36, 0.42, 0.52)
    zenith: Rgb = (0.16, 0.33, 0.66)
    horizon: Rgb = (0.62, 0.74, 0.86)

    def sky_light(self, directions: FloatArray) -> FloatArray:
        """Return the light [N, 3] from unit directions [N, 3].

        The sky is paler at the horizon, with clouds on a flat ceiling and a glow around the sun.
        """
        up = np.maximum(-directions[:, 1:2], 0.0)
        weight = np.exp(-4.0 * up)
        clear = self.horizon * weight + self.zenith * (1 - weight)
        reach = 0.35 / (up + 0.12)
        uv = directions[:, [0, 2]] * reach + self.cloud_shift
        blur = 0.004 * reach[:, 0] ** 2
        cover = textures.sample(Texture.CLOUDS, uv, 0 * uv, blur)[:, :1]
        cover *= np.minimum(1.0, 5.0 * up)  # no clouds in the haze
        towards_sun = np.maximum(directions @ self.to_sun, 0.0)[:, None]
        glow = 0.35 * towards_sun**24 * self.sun
        return clear * (1 - cover) + 0.93 * cover + glow


@dataclass(frozen=True)
class Optics:
    """Air, surfaces and lens.

    Without haze and gloss, surfaces look the same from everywhere.
    """

    haze_per_m: float = 0.0012  # extinction
    gloss: float = 1.0  # scale of the reflections of glass and paint
    blur_px: float = 0.45  # standard deviation of the lens
    finest_detail_m: float = 0.0  # textures are smoothed to this size


def shade(
    hits: Hits,
    eye: FloatArray,  # [3]
    is_lit: BoolArray,  # [N], whether the sun reaches the surface
    weather: Weather,
    optics: Optics,
) -> FloatArray:
    """Return the light [N, 3] that comes from N hits to the eye."""
    sight = hits.points - eye
    distance_m = np.linalg.norm(sight, axis=-1, keepdims=True)
    ray = sight / distance_m
    facing = -np.einsum("nj,nj->n", hits.normal, ray)[:, None]

    # The footprint of a pixel is longer along the surface, away from the eye.
    away = ray + facing * hits.normal
    away /= np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9)
    longer_m = hits.pixel_m[:, None] / np.maximum(facing, 0.02) * away
    shorter_m = np.maximum(hits.pixel_m, optics.finest_detail_m)
    longer = np.einsum("nkj,nj->nk", hits.uv_axes, longer_m)
    tiles_per_m = np.linalg.norm(hits.uv_axes, axis=-1).max(axis=-1)
    texel = textures.sample(
        hits.texture, hits.uv, longer, shorter_m * tiles_per_m
    )
    is_tinted = texel[:, 3:]  # 0 to 1
    colour = texel[:, :3] * (1 + is_tinted * (hits.tint - 1))
    colour *= _stains(hits)
    light = colour**2 * _irradiance(hits, is_lit, weather)

    reflected = weather.sky_light(ray + 2 * facing * hits.normal)
    gloss = optics.gloss * GLOSS[hits.texture, None] * (1 - 0.7 * is_tinted)
    gloss *= 0.25 + 0.75 * (1 - np.clip(facing, 0, 1)) ** 5  # Schlick 1994
    light += gloss * (reflected - light)
    transmission = np.exp(-optics.haze_per_m * distance_m)
    return light * transmission + weather.horizon * (1 - transmission)


def _irradiance(hits: Hits, is_lit: BoolArray, weather: Weather) -> FloatArray:
    """Return the light [N, 3] that arrives from sun and sky; leaves also let it through."""
    cosine = hits.normal @ weather.to_sun
    up = -hits.normal[:, 1]
    is_leaf = hits.texture == Texture.LEAVES
    direct = np.where(is_leaf, 0.25 + 0.5 * cosine, cosine)
    direct = np.maximum(direct, 0.0) * is_lit
    from_sky = np.where(is_leaf, 0.6 + 0.4 * up, 0.75 + 0.25 * up)
    return direct[:, None] * weather.sun + from_sky[:, None] * weather.ambient


def _stains(hits: Hits) -> FloatArray:
    """Return the factors [N, 1] of large stains, which hide the repetition of the textures."""
    tile_m = textures.TILE_M[Texture.STAINS]
    uv = hits.points @ [[1.0, 0.0], [0.5, 0.7], [0.0, 1.0]] / tile_m
    blur = np.minimum(4 * hits.pixel_m, 8.0) / tile_m[0]
    pattern = textures.sample(Texture.STAINS, uv, 0 * uv, blur)[:, :1]
    return 1 + STAINS[hits.texture, None] * (2 * pattern - 1)
