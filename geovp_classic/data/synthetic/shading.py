"""Light of surfaces and sky: textures, sun, sky light, gloss and haze.

Light is linear; the byte of an image is its square root (gamma 2).
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.data.synthetic.ray_casting import Hits
from geovp_classic.data.synthetic.textures import (
    TABLES,
    TILE_M,
    Texture,
    sample,
)
from geovp_classic.types import BoolArray, FloatArray

Rgb = tuple[float, float, float]


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
        horizon_weight = np.exp(-4.0 * up)
        clear = self.horizon * horizon_weight + self.zenith * (
            1 - horizon_weight
        )

        reach = 0.35 / (up + 0.12)
        uv = directions[:, [0, 2]] * reach + self.cloud_shift
        uv_steps = 0.004 * reach[:, :, None] ** 2 * np.eye(2)
        clouds = sample(Texture.CLOUDS, uv, uv_steps)
        cover = clouds[:, 3:] * np.minimum(
            1.0, 5.0 * up
        )  # no clouds in the haze

        towards_sun = np.maximum(directions @ self.to_sun, 0.0)[:, None]
        glow = 0.35 * towards_sun**24 * self.sun
        return clear * (1 - cover) + clouds[:, :3] * cover + glow


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
    min_size = optics.finest_detail_m / TILE_M[hits.texture]
    texel = sample(hits.texture, hits.uv, hits.uv_steps, min_size)
    is_tinted = texel[:, 3:]  # 0 to 1
    colour = texel[:, :3] * (1 + is_tinted * (hits.tint - 1)) * _stains(hits)
    light = colour**2 * _irradiance(hits, is_lit, weather)

    ray = sight / distance_m
    facing = -np.einsum("nj,nj->n", hits.normal, ray)[:, None]
    reflected = weather.sky_light(ray + 2 * facing * hits.normal)
    gloss = optics.gloss * _column("gloss", hits) * (1 - 0.7 * is_tinted)
    gloss *= 0.25 + 0.75 * (1 - np.clip(facing, 0, 1)) ** 5  # Schlick 1994
    light += gloss * (reflected - light)

    transmission = np.exp(-optics.haze_per_m * distance_m)
    return light * transmission + weather.horizon * (1 - transmission)


def _irradiance(hits: Hits, is_lit: BoolArray, weather: Weather) -> FloatArray:
    """Return the light [N, 3] that arrives from sun and sky; leaves also let it through."""
    cosine = hits.normal @ weather.to_sun
    through_leaves = hits.ambient * (0.25 + 0.5 * np.abs(cosine))
    is_leaf = hits.texture == Texture.LEAVES
    direct = np.where(is_leaf, through_leaves, np.maximum(cosine, 0.0)) * is_lit
    from_sky = hits.ambient * (0.75 - 0.25 * hits.normal[:, 1])
    return direct[:, None] * weather.sun + from_sky[:, None] * weather.ambient


def _stains(hits: Hits) -> FloatArray:
    """Return the factors [N, 1] of large stains, which hide the repetition of the textures."""
    tile_m = TILE_M[Texture.STAINS]
    uv = hits.points @ [[1.0, 0.0], [0.5, 0.7], [0.0, 1.0]] / tile_m
    uv_steps = np.minimum(hits.sizes_m, 8.0)[:, :, None] / tile_m * np.eye(2)
    pattern = sample(Texture.STAINS, uv, uv_steps)[:, :1]
    return 1 + _column("stains", hits) * (2 * pattern - 1)


def _column(name: str, hits: Hits) -> FloatArray:
    """Return a property [N, 1] of the textures that were hit; default: 0."""
    values = np.array([table.get(name, 0.0) for table in TABLES.values()])
    return values[hits.texture, None]
