"""Draw coloured points from any pose, the nearest in front: a z-buffer (Catmull 1974) over small flat patches.

Points are homogeneous, [x, y, z, w] with w >= 0, so that the sky needs no special case: w = 0 is infinitely far in the
direction (x, y, z), and moves with the camera's rotation only. A point (x, y, z) is [x, y, z, 1]; a pixel's ray with
inverse depth q is [ray, q].
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.geometry import se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Views

IndexArray = npt.NDArray[np.int64]

NEAR = 1e-3  # patches nearer than this, in the scene's unit, or reaching behind the camera are not drawn
NOTHING = -1
EDGE_PX2 = 1e-7  # tolerance of the inside test: patches that share an edge leave no crack


def splat(
    points_world: FloatArray,  # [N, 4], homogeneous
    colours: ByteArray,  # [N, 3]
    sizes: FloatArray,  # [N], edge of the square that a point stands for, in the scale of x, y, z
    world_from_cam: FloatArray,  # [F, 4, 4]
    camera: Intrinsics,
) -> Views:
    """The points as squares that face the camera, at least one pixel wide; black where none is seen."""
    drawn = [_draw_squares(points_world @ one.T, sizes, camera) for one in se3.inverse(world_from_cam)]
    inverse_depths, winners = (np.stack(maps) for maps in zip(*drawn, strict=True))
    covered = winners != NOTHING
    frames = np.zeros((*covered.shape, 3), dtype=np.uint8)
    frames[covered] = colours[winners[covered]]
    return Views(frames, covered, depths(inverse_depths, covered))


def depths(
    inverse_depths: FloatArray,  # [...]
    covered: npt.NDArray[np.bool_],  # [...]
) -> FloatArray:
    """Depths [...] as Views have them: inf where the inverse is 0, 0 where not covered."""
    with np.errstate(divide="ignore"):
        return np.where(covered, 1 / np.where(covered, inverse_depths, 1), 0).astype(np.float32)


def draw(
    corners_cam: FloatArray,  # [N, 4, 4]: N flat patches of four homogeneous corners, in order around the patch
    camera: Intrinsics,
) -> tuple[FloatArray, IndexArray]:
    """Inverse depth [H, W] of the nearest patch at every pixel's centre, and its number (NOTHING where there is none).

    Between its corners a patch is a plane, whose inverse depth is linear in the picture. Of equally near ones the first
    wins. Patches that reach nearer than NEAR or behind the camera are left out whole.
    """
    z, w = corners_cam[..., 2], corners_cam[..., 3]
    whole = (z > np.maximum(NEAR * w, 1e-9)).all(axis=1)
    numbers = np.flatnonzero(whole)
    seen = corners_cam[numbers]
    u = camera.fx_px * seen[..., 0] / seen[..., 2] + camera.cx_px
    v = camera.fy_px * seen[..., 1] / seen[..., 2] + camera.cy_px
    inverse_depth = np.full((camera.height_px, camera.width_px), -1.0)
    winner = np.full(inverse_depth.shape, NOTHING, dtype=np.int64)
    _rasterise(u, v, seen[..., 3] / seen[..., 2], numbers, inverse_depth, winner)
    return inverse_depth, winner


def _draw_squares(points_cam: FloatArray, sizes: FloatArray, camera: Intrinsics) -> tuple[FloatArray, IndexArray]:
    z = np.maximum(points_cam[:, 2], 1e-9)
    half_x = np.maximum(sizes, z / camera.fx_px) / 2  # never smaller than a pixel
    half_y = np.maximum(sizes, z / camera.fy_px) / 2
    corners = np.repeat(points_cam[:, None], 4, axis=1)
    corners[..., 0] += half_x[:, None] * np.array([-1, 1, 1, -1])
    corners[..., 1] += half_y[:, None] * np.array([-1, -1, 1, 1])
    return draw(corners, camera)


@numba.njit(cache=True)
def _rasterise(
    u: FloatArray,  # [N, 4]
    v: FloatArray,  # [N, 4]
    q: FloatArray,  # [N, 4]
    numbers: IndexArray,  # [N]
    inverse_depth: FloatArray,  # [H, W], drawn into
    winner: IndexArray,  # [H, W], drawn into
) -> None:
    height, width = inverse_depth.shape
    for n in range(len(u)):
        left, right = max(np.ceil(u[n].min() - EDGE_PX2), 0), min(np.floor(u[n].max() + EDGE_PX2), width - 1)
        top, bottom = max(np.ceil(v[n].min() - EDGE_PX2), 0), min(np.floor(v[n].max() + EDGE_PX2), height - 1)
        if not (left <= right and top <= bottom):
            continue
        ua, va, ub, vb = u[n, 1] - u[n, 0], v[n, 1] - v[n, 0], u[n, 3] - u[n, 0], v[n, 3] - v[n, 0]
        area = ua * vb - ub * va
        slope_u = slope_v = 0.0
        if abs(area) > EDGE_PX2:
            qa, qb = q[n, 1] - q[n, 0], q[n, 3] - q[n, 0]
            slope_u, slope_v = (qa * vb - qb * va) / area, (qb * ua - qa * ub) / area
        nearest, farthest = q[n].max(), q[n].min()
        for row in range(int(top), int(bottom) + 1):
            for column in range(int(left), int(right) + 1):
                if not _inside(u[n], v[n], column, row):
                    continue
                here = q[n, 0] + slope_u * (column - u[n, 0]) + slope_v * (row - v[n, 0])
                here = min(max(here, farthest), nearest)
                if here > inverse_depth[row, column]:
                    inverse_depth[row, column] = here
                    winner[row, column] = numbers[n]


@numba.njit(cache=True)
def _inside(u: FloatArray, v: FloatArray, column: int, row: int) -> bool:
    """Whether a pixel's centre lies in a convex quadrilateral, edges included, whichever way round it goes."""
    left = right = True
    for i in range(4):
        j = (i + 1) % 4
        cross = (u[j] - u[i]) * (row - v[i]) - (v[j] - v[i]) * (column - u[i])
        left, right = left and cross >= -EDGE_PX2, right and cross <= EDGE_PX2
    return left or right
