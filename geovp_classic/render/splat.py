"""Draw coloured points from any pose, the nearest in front: a z-buffer (Catmull 1974) over small flat patches.

Points are homogeneous, [x, y, z, w] with w >= 0, so that the sky needs no special case: w = 0 is infinitely far in the
direction (x, y, z), and moves with the camera's rotation only. A point (x, y, z) is [x, y, z, 1]; a pixel's ray with
inverse depth q is [ray, q].
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.geometry import se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Views

IndexArray = npt.NDArray[np.int64]
Outlines = tuple[FloatArray, FloatArray, FloatArray, IndexArray]
Plane = tuple[float, float, float, float, float, float, float]

NEAR = 1e-3  # patches nearer than this, in the scene's unit, or reaching behind the camera are not drawn
NOTHING = -1
EDGE_PX2 = 1e-7  # tolerance of the inside test: patches that share an edge leave no crack


@dataclass(frozen=True)
class PointScene:
    """Coloured points to be splatted; in a `Supersampled` scene their edges are smooth."""

    points_world: FloatArray  # [N, 4], homogeneous
    colours: ByteArray  # [N, 3]
    sizes: FloatArray  # [N], see `splat`
    softness: float = 0.0

    def view(self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics) -> Views:
        """The points from the poses [F, 4, 4]."""
        return splat(self.points_world, self.colours, self.sizes, world_from_cam, intrinsics, self.softness)


def splat(
    points_world: FloatArray,  # [N, 4], homogeneous
    colours: ByteArray,  # [N, 3]
    sizes: FloatArray,  # [N], edge of the square that a point stands for, in the scale of x, y, z
    world_from_cam: FloatArray,  # [F, 4, 4]
    camera: Intrinsics,
    softness: float = 0.0,
) -> Views:
    """The points as squares that face the camera, at least one pixel wide; black where none is seen.

    The nearest one has the pixel; with softness those are blended in whose inverse depth is smaller by less than that
    share, the less the farther they are (the depth threshold of surface splatting, Zwicker 2001).
    """
    frames = np.zeros((len(world_from_cam), camera.height_px, camera.width_px, 3), np.uint8)
    inverse_depths = np.empty(frames.shape[:3])
    for frame, inverse_depth, cam_from_world in zip(frames, inverse_depths, se3.inverse(world_from_cam), strict=True):
        outlines = _outlines(_squares(points_world @ cam_from_world.T, sizes, camera), camera)
        inverse_depth[:], winner = _nearest(outlines, camera)
        seen = winner != NOTHING
        frame[seen] = colours[winner[seen]]
        if softness > 0:
            _blend(*outlines, colours, softness, inverse_depth, frame)
    covered = inverse_depths >= 0
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

    Between its corners a patch is a plane, whose inverse depth is linear in the image. Of equally near ones the first
    wins. Patches that reach nearer than NEAR or behind the camera are left out whole.
    """
    return _nearest(_outlines(corners_cam, camera), camera)


def _outlines(corners_cam: FloatArray, camera: Intrinsics) -> Outlines:
    """Of the patches that are drawn: pixels u and v and inverse depths of their corners [M, 4], and their numbers."""
    z, w = corners_cam[..., 2], corners_cam[..., 3]
    whole = (z > np.maximum(NEAR * w, 1e-9)).all(axis=1)
    numbers = np.flatnonzero(whole)
    seen = corners_cam[numbers]
    u = camera.fx_px * seen[..., 0] / seen[..., 2] + camera.cx_px
    v = camera.fy_px * seen[..., 1] / seen[..., 2] + camera.cy_px
    return u, v, seen[..., 3] / seen[..., 2], numbers


def _nearest(outlines: Outlines, camera: Intrinsics) -> tuple[FloatArray, IndexArray]:
    inverse_depth = np.full((camera.height_px, camera.width_px), -1.0)
    winner = np.full(inverse_depth.shape, NOTHING, dtype=np.int64)
    _rasterise(*outlines, inverse_depth, winner)
    return inverse_depth, winner


def _squares(points_cam: FloatArray, sizes: FloatArray, camera: Intrinsics) -> FloatArray:
    """The corners [N, 4, 4] of what points stand for."""
    z = np.maximum(points_cam[:, 2], 1e-9)
    half_x = np.maximum(sizes, z / camera.fx_px) / 2  # never smaller than a pixel
    half_y = np.maximum(sizes, z / camera.fy_px) / 2
    corners = np.repeat(points_cam[:, None], 4, axis=1)
    corners[..., 0] += half_x[:, None] * np.array([-1, 1, 1, -1])
    corners[..., 1] += half_y[:, None] * np.array([-1, -1, 1, 1])
    return corners


@numba.njit(cache=True)
def _rasterise(
    u: FloatArray,  # [N, 4]
    v: FloatArray,  # [N, 4]
    q: FloatArray,  # [N, 4]
    numbers: IndexArray,  # [N]
    inverse_depth: FloatArray,  # [H, W], drawn into
    winner: IndexArray,  # [H, W], drawn into
) -> None:
    for n in range(len(u)):
        left, right, top, bottom = _box(u[n], v[n], inverse_depth.shape)
        plane = _plane(u[n], v[n], q[n])
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                if _inside(u[n], v[n], column, row):
                    here = _met(plane, column, row)
                    if here > inverse_depth[row, column]:
                        inverse_depth[row, column] = here
                        winner[row, column] = numbers[n]


@numba.njit(cache=True)
def _blend(
    u: FloatArray,  # [N, 4]
    v: FloatArray,  # [N, 4]
    q: FloatArray,  # [N, 4]
    numbers: IndexArray,  # [N]
    colours: ByteArray,
    softness: float,
    inverse_depth: FloatArray,  # [H, W] of the nearest
    frame: ByteArray,  # [H, W, 3], drawn into
) -> None:
    sums, weights = np.zeros(frame.shape), np.zeros(inverse_depth.shape)
    for n in range(len(u)):
        left, right, top, bottom = _box(u[n], v[n], inverse_depth.shape)
        plane = _plane(u[n], v[n], q[n])
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                if _inside(u[n], v[n], column, row):
                    nearest = inverse_depth[row, column]
                    weight = 1.0
                    if nearest > 0:
                        weight = 1 - (1 - _met(plane, column, row) / nearest) / softness
                    if weight > 0:
                        weights[row, column] += weight
                        for channel in range(3):
                            sums[row, column, channel] += weight * colours[numbers[n], channel]
    for row in range(frame.shape[0]):
        for column in range(frame.shape[1]):
            for channel in range(3):
                if weights[row, column] > 0:
                    frame[row, column, channel] = np.uint8(sums[row, column, channel] / weights[row, column] + 0.5)


@numba.njit(cache=True)
def _box(u: FloatArray, v: FloatArray, shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """The first and last column and row whose centres may lie inside; empty (last before first) for none."""
    left, right = max(np.ceil(u.min() - EDGE_PX2), 0), min(np.floor(u.max() + EDGE_PX2), shape[1] - 1)
    top, bottom = max(np.ceil(v.min() - EDGE_PX2), 0), min(np.floor(v.max() + EDGE_PX2), shape[0] - 1)
    if not (left <= right and top <= bottom):
        return 0, -1, 0, -1
    return int(left), int(right), int(top), int(bottom)


@numba.njit(cache=True)
def _plane(u: FloatArray, v: FloatArray, q: FloatArray) -> Plane:
    """Where it begins (u, v, q), how inverse depth grows along u and v, and between which values it stays."""
    ua, va, ub, vb = u[1] - u[0], v[1] - v[0], u[3] - u[0], v[3] - v[0]
    area = ua * vb - ub * va
    slope_u = slope_v = 0.0
    if abs(area) > EDGE_PX2:
        qa, qb = q[1] - q[0], q[3] - q[0]
        slope_u, slope_v = (qa * vb - qb * va) / area, (qb * ua - qa * ub) / area
    return u[0], v[0], q[0], slope_u, slope_v, q.min(), q.max()


@numba.njit(cache=True)
def _met(plane: Plane, column: int, row: int) -> float:
    """Its inverse depth at a pixel's centre."""
    u, v, q, slope_u, slope_v, farthest, nearest = plane
    return min(max(q + slope_u * (column - u) + slope_v * (row - v), farthest), nearest)


@numba.njit(cache=True)
def _inside(u: FloatArray, v: FloatArray, column: int, row: int) -> bool:
    """Whether a pixel's centre lies in a convex quadrilateral, edges included, whichever way round it goes."""
    left = right = True
    for i in range(4):
        j = (i + 1) % 4
        cross = (u[j] - u[i]) * (row - v[i]) - (v[j] - v[i]) * (column - u[i])
        left, right = left and cross >= -EDGE_PX2, right and cross <= EDGE_PX2
    return left or right
