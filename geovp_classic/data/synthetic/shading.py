"""How bright a surface is where a ray meets it: textures filtered over the pixel's footprint, sun, sky light and haze.

Light is linear; a picture's byte is the square root of it (gamma 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.data.synthetic.mesh import Soup, normals
from geovp_classic.data.synthetic.sampling import sample
from geovp_classic.data.synthetic.textures import TILE_M, Atlas, IntArray, Texture
from geovp_classic.types import BoolArray, FloatArray

TILES_M = np.array([TILE_M[texture] for texture in Texture])
BLOTCHES = np.zeros(len(Texture), dtype=np.float32)  # how much large stains show on a texture
BLOTCHES[[Texture.ASPHALT, Texture.GRASS, Texture.WOODS]] = 0.28
BLOTCHES[[Texture.PAVEMENT, Texture.PLASTER, Texture.BRICK, Texture.ROOF]] = 0.14


@dataclass(frozen=True)
class Surfaces:
    """Triangles as the shader wants them: u, v, paint u, paint v and shade as linear functions of the place."""

    corner: FloatArray  # [N, 3] float32
    normal: FloatArray  # [N, 3] float32
    at_corner: FloatArray  # [N, 5] float32
    gradient: FloatArray  # [N, 5, 3] float32, per metre
    texture: IntArray  # [N]
    paint: IntArray  # [N]
    tint: FloatArray  # [N, 3] float32
    gloss: FloatArray  # [N] float32

    def take(self, triangles: IntArray) -> Surfaces:
        """The rows of some triangles [K]."""
        return Surfaces(**{name: column[triangles] for name, column in vars(self).items()})

    def replaced(self, where: BoolArray, other: Surfaces) -> Surfaces:
        """The same rows but for those where [N] is True, which become the other's, in order."""
        columns = {name: column.copy() for name, column in vars(self).items()}
        for name, column in columns.items():
            column[where] = getattr(other, name)
        return Surfaces(**columns)


def surfaces_of(soup: Soup) -> Surfaces:
    """The table of a soup; triangles without area get constant values."""
    corners = soup.corners.astype(np.float64)
    values = np.concatenate([soup.uv, soup.paint_uv, soup.shade[..., None]], axis=-1)  # [N, 3, 5]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    aa, ab, bb = (a * a).sum(-1), (a * b).sum(-1), (b * b).sum(-1)
    area = aa * bb - ab * ab
    scale = np.where(area > 1e-12, 1.0 / np.where(area > 1e-12, area, 1.0), 0.0)[:, None]
    dual_a = ((bb[:, None] * a - ab[:, None] * b) * scale).astype(np.float32)
    dual_b = ((aa[:, None] * b - ab[:, None] * a) * scale).astype(np.float32)
    rise_a, rise_b = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    return Surfaces(
        corner=soup.corners[:, 0],
        normal=normals(soup.corners),
        at_corner=values[:, 0],
        gradient=rise_a[..., None] * dual_a[:, None] + rise_b[..., None] * dual_b[:, None],
        texture=soup.texture,
        paint=soup.paint,
        tint=soup.tint,
        gloss=soup.gloss,
    )


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
    blur_px: float = 0.45  # spread of the lens; more than 0.7 makes pictures that survive resampling
    finest_detail_m: float = 0.0  # smooths textures to this size


@dataclass(frozen=True)
class Rays:
    """Straight lines from the eye to the surfaces that they meet."""

    eye: FloatArray  # [3]
    directions: FloatArray  # [N, 3] float32, world frame, of z-depth 1
    depths: FloatArray  # [N] float32
    pixel_steps: FloatArray  # [2, 3], how a direction changes to the next pixel right and down


def shade(
    atlas: Atlas,
    surfaces: Surfaces,  # N rows, one per ray
    rays: Rays,
    lit: BoolArray,  # [N], whether the sun gets there
    weather: Weather,
    optics: Optics,
) -> FloatArray:
    """Light [N, 3] that comes along rays from the surfaces they meet."""
    depth, length = rays.depths[:, None], np.sqrt(dot(rays.directions, rays.directions))
    against = dot(surfaces.normal, rays.directions)
    normal = surfaces.normal * -np.sign(against)
    facing = np.asarray(np.minimum(-np.abs(against), -1e-4 * length))
    steps = [  # how the point moves to the next pixel: in the plane of the triangle
        depth * (change - (normal @ change)[:, None] / facing * rays.directions)
        for change in rays.pixel_steps.astype(np.float32)
    ]
    points = rays.eye.astype(np.float32) + depth * rays.directions
    albedo, around = _albedo(atlas, surfaces, points, steps, optics.finest_detail_m)
    diffuse = albedo * _incoming(weather, normal, lit, around, surfaces.texture == Texture.LEAVES)
    gloss = surfaces.gloss * np.float32(optics.gloss)
    colour = _mirrored(atlas, weather, diffuse, gloss, rays.directions / length, normal)
    clear = np.exp(np.float32(-optics.haze_per_m) * depth * length)
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
    spread = np.concatenate([0.004 * reach**2, np.zeros_like(reach)], axis=-1)
    place = directions[:, [0, 2]] * reach + weather.cloud_shift
    clouds = sample(atlas, np.full(len(up), int(Texture.CLOUDS)), place, spread, spread[:, ::-1])
    clouds *= np.minimum(1.0, 5.0 * up)  # none in the haze
    glow = np.maximum(directions @ _light(weather.to_sun), 0.0)[:, None] ** 24 * np.float32(0.35)
    return clear * (1 - clouds[:, 3:]) + np.float32(0.93) * clouds[:, :3] + glow * _light(weather.sun)


def _albedo(
    atlas: Atlas,
    surfaces: Surfaces,  # N rows
    points: FloatArray,  # [N, 3]
    steps: list[FloatArray],  # two of [N, 3]
    finest_m: float,
) -> tuple[FloatArray, FloatArray]:
    """Linear reflectance [N, 3] and the share [N, 1] of the light from all around that arrives."""
    offsets = np.stack([points - surfaces.corner, *steps], axis=-1)  # [N, 3, 3]
    change = surfaces.gradient @ offsets  # [N, 5, 3]
    values = surfaces.at_corner + change[..., 0]
    finest = (finest_m / TILES_M).astype(np.float32)
    colour = sample(
        atlas, surfaces.texture, values[:, :2], change[:, :2, 1], change[:, :2, 2], finest[surfaces.texture]
    )
    colour = colour[:, :3] * surfaces.tint
    rough = np.nonzero(BLOTCHES[surfaces.texture] > 0)[0]
    tone = _blotches(atlas, surfaces.normal[rough], points[rough], [step[rough] for step in steps])
    colour[rough] *= 1 + BLOTCHES[surfaces.texture[rough], None] * tone
    painted = np.nonzero(surfaces.paint >= 0)[0]
    paint, change = surfaces.paint[painted], change[painted]
    coat = sample(atlas, paint, values[painted, 2:4], change[:, 2:4, 1], change[:, 2:4, 2], finest[paint])
    colour[painted] = colour[painted] * (1 - coat[:, 3:]) + coat[:, :3]
    return colour**2, np.clip(values[:, 4:], 0.0, 1.2)


def _blotches(atlas: Atlas, normal: FloatArray, points: FloatArray, steps: list[FloatArray]) -> FloatArray:
    """Large soft stains [N, 1], -1 to 1, that hide the repetition of the textures."""
    flat = np.abs(normal[:, 1:2]) > 0.5
    sizes = [np.minimum(np.sqrt(dot(step, step)), 8.0) for step in steps]
    zero = np.zeros_like(sizes[0])
    upright = np.concatenate([points[:, :1] + np.float32(0.7) * points[:, 2:], points[:, 1:2]], axis=-1)
    tile_m = np.float32(TILE_M[Texture.MACRO])
    place = np.where(flat, points[:, [0, 2]], upright) / tile_m
    step_x, step_y = (np.concatenate(pair, axis=-1) / tile_m for pair in ((sizes[0], zero), (zero, sizes[1])))
    return 2 * sample(atlas, np.full(len(points), int(Texture.MACRO)), place, step_x, step_y)[:, :1] - 1


def _incoming(
    weather: Weather, normal: FloatArray, lit: BoolArray, around: FloatArray, leaves: BoolArray
) -> FloatArray:
    """Light [N, 3] that falls on the surfaces; leaves let it through."""
    toward = (normal @ _light(weather.to_sun))[:, None]
    direct = np.where(leaves[:, None], around * (0.25 + 0.5 * np.abs(toward)), np.maximum(toward, 0.0)) * lit[:, None]
    return direct * _light(weather.sun) + around * (0.75 - 0.25 * normal[:, 1:2]) * _light(weather.sky)


def _mirrored(
    atlas: Atlas, weather: Weather, colour: FloatArray, gloss: FloatArray, ray: FloatArray, normal: FloatArray
) -> FloatArray:
    """Colours [N, 3] with the sky mixed in that glass and paint mirror, more so at grazing angles (Schlick 1994)."""
    shiny = np.nonzero(gloss > 0)[0]
    cosine = -dot(normal[shiny], ray[shiny])
    share = gloss[shiny, None] * (0.25 + 0.75 * (1 - np.clip(cosine, 0, 1)) ** 5)
    seen = sky_light(atlas, weather, ray[shiny] + 2 * cosine * normal[shiny])
    colour = colour.copy()
    colour[shiny] += (seen - colour[shiny]) * share
    return colour


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Inner products [N, 1]."""
    return np.einsum("ni,ni->n", a, b)[:, None]


def _light(colour: FloatArray) -> FloatArray:
    """The same numbers in single precision, so that arrays they meet stay there."""
    return colour.astype(np.float32)
