"""How bright a surface is where a ray meets it: textures filtered over the pixel's footprint, sun, sky light and haze.

Light is linear; a picture's byte is the square root of it (gamma 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.data.synthetic.mesh import Soup, normals
from geovp_classic.data.synthetic.sampling import sample
from geovp_classic.data.synthetic.textures import TILE_M, Atlas, Texture
from geovp_classic.types import BoolArray, FloatArray

ROUGH = (
    Texture.ASPHALT,
    Texture.PAVEMENT,
    Texture.GRASS,
    Texture.PLASTER,
    Texture.BRICK,
    Texture.ROOF,
    Texture.WOODS,
)  # these get large-scale blotches, which hide that they repeat
TILES_M = np.array([TILE_M[texture] for texture in Texture])
IS_ROUGH = np.array([texture in ROUGH for texture in Texture])


@dataclass(frozen=True)
class Surfaces:
    """Triangles as the shader wants them: u, v, paint u, paint v and shade as linear functions of the place."""

    corner: FloatArray  # [N, 3] float32
    normal: FloatArray  # [N, 3] float32
    at_corner: FloatArray  # [N, 5] float32
    gradient: FloatArray  # [N, 5, 3] float32, per metre
    texture: FloatArray  # [N] int32
    paint: FloatArray  # [N] int32
    tint: FloatArray  # [N, 3] float32
    gloss: FloatArray  # [N] float32


def surfaces_of(soup: Soup) -> Surfaces:
    """The table of a soup; triangles without area get constant values."""
    corners = soup.corners
    values = np.concatenate([soup.uv, soup.paint_uv, soup.shade[..., None]], axis=-1)  # [N, 3, 5]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    aa, ab, bb = (a * a).sum(-1), (a * b).sum(-1), (b * b).sum(-1)
    area = aa * bb - ab * ab
    scale = np.where(area > 1e-12, 1.0 / np.where(area > 1e-12, area, 1.0), 0.0)[:, None]
    dual_a = (bb[:, None] * a - ab[:, None] * b) * scale
    dual_b = (aa[:, None] * b - ab[:, None] * a) * scale
    rise_a, rise_b = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    gradient = rise_a[..., None] * dual_a[:, None] + rise_b[..., None] * dual_b[:, None]
    return Surfaces(
        corner=corners[:, 0].astype(np.float32),
        normal=normals(corners).astype(np.float32),
        at_corner=values[:, 0].astype(np.float32),
        gradient=gradient.astype(np.float32),
        texture=soup.texture.astype(np.int32),
        paint=soup.paint.astype(np.int32),
        tint=soup.tint.astype(np.float32),
        gloss=soup.gloss.astype(np.float32),
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
    haze_per_m: float
    gloss: float  # scales all mirroring
    finest_m: float  # detail smaller than this is smoothed away


def shade(
    atlas: Atlas,
    surfaces: Surfaces,
    weather: Weather,
    eye: FloatArray,  # [3]
    directions: FloatArray,  # [N, 3] float32, world frame, of z-depth 1
    depths: FloatArray,  # [N] float32, inf for sky
    triangles: FloatArray,  # [N] int, -1 for sky
    lit: FloatArray,  # [N], 1 in the sun, 0 in the shadow
    pixel_steps: FloatArray,  # [2, 3], how a direction changes to the next pixel right and down
) -> FloatArray:
    """Light [N, 3] float32 that comes along the rays."""
    light = np.empty(directions.shape, dtype=np.float32)
    length = np.linalg.norm(directions, axis=-1)
    sky = triangles < 0
    light[sky] = sky_light(atlas, weather, directions[sky] / length[sky, None])
    solid = np.nonzero(~sky)[0]
    ray, depth, triangle, length = directions[solid], depths[solid, None], triangles[solid], length[solid, None]
    normal = surfaces.normal[triangle]
    facing = _dot(normal, ray)
    normal, facing = normal * -np.sign(facing), np.minimum(-np.abs(facing), -1e-4 * length)
    steps = [  # how the point moves to the next pixel: in the plane of the triangle
        depth * (change - _dot(normal, change) / facing * ray) for change in pixel_steps.astype(np.float32)
    ]
    points = eye + depth * ray
    albedo, around = _albedo(atlas, surfaces, triangle, points, steps, weather.finest_m)
    colour = albedo * _incoming(weather, normal, lit[solid], around, surfaces.texture[triangle] == Texture.LEAVES)
    colour = _mirrored(atlas, weather, colour, surfaces.gloss[triangle], ray / length, normal)
    clear = np.exp(-weather.haze_per_m * depth * length)
    light[solid] = colour * clear + weather.horizon * (1 - clear)
    return light


def sky_light(
    atlas: Atlas,
    weather: Weather,
    directions: FloatArray,  # [N, 3], unit
) -> FloatArray:
    """Light [N, 3] of the sky: brighter towards the horizon, clouds on a ceiling, a glow around the sun."""
    up = np.maximum(-directions[:, 1:2], 0.0)
    fade = np.exp(-4.0 * up)
    clear = weather.horizon * fade + weather.zenith * (1 - fade)
    reach = 0.35 / (up + 0.12)
    spread = np.concatenate([0.004 * reach**2, np.zeros_like(reach)], axis=-1)
    place = directions[:, [0, 2]] * reach + weather.cloud_shift
    clouds = sample(atlas, np.full(len(up), int(Texture.CLOUDS)), place, spread, spread[:, ::-1])
    cover = clouds[:, 3:] * np.minimum(1.0, 5.0 * up)
    glow = np.maximum(directions @ weather.to_sun, 0.0)[:, None] ** 24 * 0.35
    return clear * (1 - cover) + clouds[:, :1] ** 2 * cover + glow * weather.sun


def _albedo(
    atlas: Atlas,
    surfaces: Surfaces,
    triangles: FloatArray,  # [N]
    points: FloatArray,  # [N, 3]
    steps: list[FloatArray],  # two of [N, 3]
    finest_m: float,
) -> tuple[FloatArray, FloatArray]:
    """Linear reflectance [N, 3] and the share [N, 1] of the light from all around that arrives."""
    gradient = surfaces.gradient[triangles]  # [N, 5, 3]
    values = surfaces.at_corner[triangles] + _apply(gradient, points - surfaces.corner[triangles])
    over_x, over_y = (_apply(gradient[:, :4], step) for step in steps)
    texture, paint = surfaces.texture[triangles], surfaces.paint[triangles]
    colour = (
        sample(atlas, texture, values[:, :2], over_x[:, :2], over_y[:, :2], finest_m / TILES_M[texture])[:, :3]
        * surfaces.tint[triangles]
    )
    rough = np.nonzero(IS_ROUGH[texture])[0]
    colour[rough] *= _blotches(atlas, surfaces.normal[triangles[rough]], points[rough], [step[rough] for step in steps])
    painted = np.nonzero(paint >= 0)[0]
    coat = sample(
        atlas,
        paint[painted],
        values[painted, 2:4],
        over_x[painted, 2:],
        over_y[painted, 2:],
        finest_m / TILES_M[paint[painted]],
    )
    colour[painted] += (coat[:, :3] - colour[painted]) * coat[:, 3:]
    return colour**2, np.clip(values[:, 4:], 0.0, 1.2)


def _blotches(atlas: Atlas, normal: FloatArray, points: FloatArray, steps: list[FloatArray]) -> FloatArray:
    """Large soft stains [N, 1] that hide the repetition of the textures."""
    flat = np.abs(normal[:, 1:2]) > 0.5
    sizes = [np.minimum(np.linalg.norm(step, axis=-1, keepdims=True), 8.0) for step in steps]
    zero = np.zeros_like(sizes[0])
    upright = np.concatenate([points[:, :1] + 0.7 * points[:, 2:], points[:, 1:2]], axis=-1)
    place = np.where(flat, points[:, [0, 2]], upright) / TILE_M[Texture.MACRO]
    step_x, step_y = (
        np.concatenate(pair, axis=-1) / TILE_M[Texture.MACRO] for pair in ((sizes[0], zero), (zero, sizes[1]))
    )
    return 0.72 + 0.56 * sample(atlas, np.full(len(points), int(Texture.MACRO)), place, step_x, step_y)[:, :1]


def _incoming(
    weather: Weather, normal: FloatArray, lit: FloatArray, around: FloatArray, leaves: BoolArray
) -> FloatArray:
    """Light [N, 3] that falls on the surfaces; leaves let it through."""
    toward = (normal @ weather.to_sun)[:, None]
    direct = np.where(leaves[:, None], around * (0.25 + 0.5 * np.abs(toward)), np.maximum(toward, 0.0)) * lit[:, None]
    return direct * weather.sun + around * (0.75 - 0.25 * normal[:, 1:2]) * weather.sky


def _mirrored(
    atlas: Atlas, weather: Weather, colour: FloatArray, gloss: FloatArray, ray: FloatArray, normal: FloatArray
) -> FloatArray:
    """Colours [N, 3] with the sky mixed in that glass and paint mirror, more so at grazing angles (Schlick 1994)."""
    shiny = np.nonzero(gloss * weather.gloss > 0)[0]
    cosine = -_dot(normal[shiny], ray[shiny])
    share = (gloss[shiny, None] * weather.gloss) * (0.25 + 0.75 * (1 - np.clip(cosine, 0, 1)) ** 5)
    seen = sky_light(atlas, weather, ray[shiny] + 2 * cosine * normal[shiny])
    colour = colour.copy()
    colour[shiny] += (seen - colour[shiny]) * share
    return colour


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Inner products [N, 1]."""
    return (a * b).sum(axis=-1, keepdims=True)


def _apply(gradient: FloatArray, offset: FloatArray) -> FloatArray:
    """The change [N, K] of K linear functions over an offset [N, 3]."""
    return np.einsum("nkj,nj->nk", gradient, offset)
