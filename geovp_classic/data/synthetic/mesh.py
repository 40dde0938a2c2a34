"""Textured triangle meshes, built from grids of points.

Objects use a frame with x to the right, y down and z ahead. Heights above the ground are therefore
negative y.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from geovp_classic.data.synthetic.textures import TILE_M, Texture
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, IntArray

Colour = npt.ArrayLike  # [3], 0 to 1
WHITE = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class TriangleMesh:
    """Triangles with the values that shading needs, per corner or per triangle."""

    corners: FloatArray  # [N, 3, 3], metres
    uv: FloatArray  # [N, 3, 2], in tiles of the texture
    ambient: (
        FloatArray  # [N, 3], fraction of the sky light that reaches the corner
    )
    texture: IntArray  # [N]
    tint: FloatArray  # [N, 3]

    def moved(self, world_from_object: FloatArray, scale: float = 1.0) -> Self:
        """Return the triangles scaled about the origin, then moved by a transform [4, 4]."""
        points = scale * self.corners.reshape(-1, 3)
        corners = se3.transform(world_from_object, points)
        return replace(self, corners=corners.reshape(-1, 3, 3))

    def selected(self, triangles: IntArray) -> Self:
        """Return the triangles with the given numbers [K]."""
        columns = (values[triangles] for values in vars(self).values())
        return type(self)(*columns)


def joined(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """Return all triangles in one mesh, in the given order."""
    columns = zip(*(vars(mesh).values() for mesh in meshes), strict=True)
    return TriangleMesh(*(np.concatenate(column) for column in columns))


def triangles(
    corners: FloatArray,  # [N, 3, 3]
    texture: Texture,
    tint: Colour = WHITE,
    uv: FloatArray | None = None,  # [N, 3, 2]
    ambient: npt.ArrayLike = 1.0,  # [N, 3]
) -> TriangleMesh:
    """Return triangles of one texture and tint.

    Without `uv`, the texture is projected along the axis that is closest to the normal.
    """
    count = len(corners)
    if uv is None:
        cross = np.cross(
            corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        )
        normal_axis = np.abs(cross).argmax(axis=-1)
        uv_axes = np.array([[2, 1], [0, 2], [0, 1]])[normal_axis]  # [N, 2]
        uv = (
            np.take_along_axis(corners, uv_axes[:, None], axis=-1)
            / TILE_M[texture]
        )
    return TriangleMesh(
        corners,
        uv,
        np.broadcast_to(ambient, (count, 3)),
        np.full(count, int(texture)),
        np.broadcast_to(np.asarray(tint), (count, 3)),
    )


def sheet(
    points: npt.ArrayLike,  # [R, K, 3]
    texture: Texture,
    tint: Colour = WHITE,
    uv: tuple[npt.ArrayLike, npt.ArrayLike]
    | None = None,  # u and v in tiles, each [R, K]
    ambient: npt.ArrayLike = 1.0,  # [R, K]
) -> TriangleMesh:
    """Return the surface through R rows of K points, with two triangles per cell."""
    grid = np.asarray(points, dtype=np.float64)
    shape = grid.shape[:2]
    uv_corners = None
    if uv is not None:
        u, v = (np.broadcast_to(values, shape) for values in uv)
        uv_corners = _split_cells(np.stack([u, v], axis=-1))
    ambient_corners = _split_cells(np.broadcast_to(ambient, shape))
    return triangles(
        _split_cells(grid), texture, tint, uv_corners, ambient_corners
    )


def box(
    centre: tuple[float, float, float],
    half_size: tuple[float, float, float],
    texture: Texture,
    tint: Colour = WHITE,
) -> TriangleMesh:
    """Return a box without its underside."""
    foot = np.array(
        [(-1, 1, -1), (1, 1, -1), (1, 1, 1), (-1, 1, 1), (-1, 1, -1)]
    )
    rows = np.stack([foot, foot * [1, -1, 1], foot * [0, -1, 0]])
    return sheet(centre + rows * half_size, texture, tint)


def lathe(
    start: npt.ArrayLike,  # [3]
    end: npt.ArrayLike,  # [3]
    profile: npt.ArrayLike,  # [R, 2], fraction of the way and radius in metres
    num_sides: int = 8,
) -> FloatArray:
    """Return rings of points [R, num_sides + 1, 3] around a line."""
    axis = np.subtract(end, start)
    side = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    side /= np.linalg.norm(side)
    other_side = np.cross(axis / np.linalg.norm(axis), side)
    angle_rad = np.linspace(0, 2 * np.pi, num_sides + 1)[:, None]
    ring = np.cos(angle_rad) * side + np.sin(angle_rad) * other_side
    along, radius_m = np.asarray(profile, dtype=np.float64).T[..., None, None]
    return np.asarray(start) + along * axis + radius_m * ring


def _split_cells(grid: FloatArray) -> FloatArray:
    """Return the triangles' corners [N, 3, ...] of a grid [R, K, ...], two per cell."""
    a = grid[:-1, :-1]
    b = grid[:-1, 1:]
    c = grid[1:, 1:]
    d = grid[1:, :-1]
    return np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, *grid.shape[2:])
