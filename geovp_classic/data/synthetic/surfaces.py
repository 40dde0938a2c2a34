"""What rays see of triangles: the place, the way it faces, and the patch of every texture that a pixel covers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from geovp_classic.data.synthetic.mesh import Soup, normals
from geovp_classic.data.synthetic.textures import IntArray
from geovp_classic.types import FloatArray

GRAZING = 1e-4  # the least cosine between ray and surface that is reckoned with


@dataclass(frozen=True)
class Surfaces:
    """Triangles with u, v, paint u, paint v and shade as linear functions of the place; all in single precision."""

    corner: FloatArray  # [N, 3]
    normal: FloatArray  # [N, 3]
    at_corner: FloatArray  # [N, 5]
    gradient: FloatArray  # [N, 5, 3], per metre
    texture: IntArray  # [N]
    paint: IntArray  # [N]
    tint: FloatArray  # [N, 3]
    gloss: FloatArray  # [N]


@dataclass(frozen=True)
class Rays:
    """Straight lines from the eye to the triangles that they meet."""

    eye: FloatArray  # [3]
    directions: FloatArray  # [N, 3] float32, world frame, of z-depth 1
    depths: FloatArray  # [N] float32
    triangles: IntArray  # [N]
    pixel_steps: FloatArray  # [2, 3], how a direction changes to the next pixel right and down


@dataclass(frozen=True)
class Patches:
    """The pieces of surface that rays meet; steps are changes to the next pixel right and down."""

    points: FloatArray  # [N, 3]
    normal: FloatArray  # [N, 3], towards the eye
    uv: FloatArray  # [N, 2]
    uv_steps: FloatArray  # [N, 2, 2], right and down x u and v
    paint_uv: FloatArray  # [N, 2]
    paint_steps: FloatArray  # [N, 2, 2]
    around: FloatArray  # [N], share of the light from all around that arrives
    sizes_m: FloatArray  # [N, 2], how far the place moves
    texture: IntArray  # [N]
    paint: IntArray  # [N]
    tint: FloatArray  # [N, 3]
    gloss: FloatArray  # [N]


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


def patches(surfaces: Surfaces, rays: Rays) -> Patches:
    """What the rays meet; a pixel's footprint is a parallelogram in the plane of the triangle."""
    count = len(rays.depths)
    shapes = ((3,), (3,), (2,), (2, 2), (2,), (2, 2), (), (2,))
    out = tuple(np.empty((count, *shape), dtype=np.float32) for shape in shapes)
    triangles = np.ascontiguousarray(rays.triangles, dtype=np.int64)
    _patches(
        (surfaces.corner, surfaces.normal, surfaces.at_corner, surfaces.gradient),
        triangles,
        np.ascontiguousarray(rays.eye, dtype=np.float64),
        np.ascontiguousarray(rays.directions, dtype=np.float32),
        np.ascontiguousarray(rays.depths, dtype=np.float32),
        np.ascontiguousarray(rays.pixel_steps, dtype=np.float64),
        out,
    )
    columns = (surfaces.texture, surfaces.paint, surfaces.tint, surfaces.gloss)
    return Patches(*out, *(column.take(triangles, axis=0) for column in columns))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _patches(surfaces, triangles, eye, directions, depths, pixel_steps, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    corner, normals_, at_corner, gradient = surfaces
    points, normal, uv, uv_steps, paint_uv, paint_steps, around, sizes_m = out
    offset, step = np.zeros(3), np.zeros(3)
    for i in range(len(depths)):
        triangle, depth, ray, facing = triangles[i], depths[i], directions[i], normals_[triangles[i]]
        against = facing[0] * ray[0] + facing[1] * ray[1] + facing[2] * ray[2]
        sign = 1.0 if against < 0.0 else -1.0
        length = math.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2])
        against = min(-abs(against), -GRAZING * length) * sign
        for axis in range(3):
            place = eye[axis] + depth * ray[axis]
            points[i, axis], offset[axis] = place, place - corner[triangle, axis]
            normal[i, axis] = sign * facing[axis]
        for k in range(5):
            slope = gradient[triangle, k]
            value = at_corner[triangle, k] + slope[0] * offset[0] + slope[1] * offset[1] + slope[2] * offset[2]
            if k < 2:
                uv[i, k] = value
            elif k < 4:
                paint_uv[i, k - 2] = value
            else:
                around[i] = min(max(value, 0.0), 1.2)
        for to in range(2):
            change = pixel_steps[to]
            along = (facing[0] * change[0] + facing[1] * change[1] + facing[2] * change[2]) / against
            for axis in range(3):
                step[axis] = depth * (change[axis] - along * ray[axis])
            sizes_m[i, to] = math.sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2])
            for k in range(4):
                slope = gradient[triangle, k]
                value = slope[0] * step[0] + slope[1] * step[1] + slope[2] * step[2]
                if k < 2:
                    uv_steps[i, to, k] = value
                else:
                    paint_steps[i, to, k - 2] = value
