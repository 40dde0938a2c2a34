"""Observed pixels as small flat patches in space (surfels), rasterised from any pose with a
z-buffer.

A patch is what one pixel of a source image shows: the square around it, at its inverse depth and
with the slope of its surface, so that approached surfaces neither tear nor lose their planes.
Inverse depth 0 is infinitely far and needs no special case: a pixel (u, v, 1) with inverse depth q
is seen at A (u, v, 1) + q b, with A = K' R K^-1 and b = K' t (Hartley & Zisserman 2004, eq. 13.2).
"""

from dataclasses import dataclass

import numba
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.parallel import parallel_map
from geovp_classic.rendering.rasterizer import HALF_PX, NO_INDEX, IndexArray, rasterise_views
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics

STRAIGHT = 0.5  # a surface is straight where the next step differs by less than this share
# largest width of a patch in a coarser view, at the same depth; smaller ones are thinned out
COARSE_PATCH_PX = 0.7
BAND_ROWS = 64  # that a thread works on at a time
FLAT = 0.02  # a step of less than this share of the inverse depth is a slope in any case


@dataclass(frozen=True)
class Source:
    """A posed image."""

    frame: ByteArray  # [H, W, 3]
    camera: Intrinsics
    world_from_source: FloatArray  # [4, 4]
    detail: ByteArray | None = None  # [H', W', 3], the same image with more pixels


@dataclass(frozen=True)
class Patches:
    """Pixels of several sources with their place in space."""

    pixels: FloatArray  # [N, 2] float32, (u, v) in their source
    inverse_depth: FloatArray  # [N] float32
    slope: FloatArray  # [N, 2] float32, of the inverse depth per pixel along u and v
    source: IndexArray  # [N], which source

    def __len__(self) -> int:
        """N."""
        return len(self.pixels)


def from_depth_map(
    inverse_depth: FloatArray,  # [H, W], 0 = infinitely far
    known: BoolArray,  # [H, W]
    source: int,
) -> Patches:
    """The patches of all known pixels of one image."""
    q = np.where(known, inverse_depth, np.nan).astype(np.float32)
    v, u = np.nonzero(known)
    pixels, number = np.empty((len(u), 2), np.float32), np.full(len(u), source, dtype=np.int32)
    pixels[:, 0], pixels[:, 1] = u, v
    return Patches(pixels, q[known], slopes(q)[known], number)


def concatenate(clouds: list[Patches]) -> Patches:
    """All patches in one; earlier parts win where patches are equally near."""
    columns = [
        np.concatenate([getattr(one, name) for one in clouds])
        for name in Patches.__dataclass_fields__
    ]
    return Patches(*columns)


def rasterise(
    cloud: Patches,
    sources: list[Source],
    world_from_cam: FloatArray,  # [F, 4, 4]
    camera: Intrinsics,
) -> tuple[FloatArray, IndexArray]:
    """Inverse depth [F, H, W] of the nearest patch at every pixel's centre, and its number
    (NO_INDEX for none).

    For views that are much coarser than the sources, every n-th patch along u and v, n times as
    wide, stands for all.
    """
    every = max(1, int(COARSE_PATCH_PX * sources[0].camera.fx_px / camera.fx_px))
    to_views = [projections(source, world_from_cam, camera) for source in sources]
    a, b = (
        np.stack(maps, axis=1) for maps in zip(*to_views, strict=True)
    )  # [F, sources, 3, 3], [F, sources, 3]
    size = (len(world_from_cam), camera.height_px, camera.width_px)
    inverse_depth = np.full(size, -1.0, dtype=np.float32)
    winner = np.full(size, NO_INDEX, dtype=np.int32)
    columns, source = np.stack([*cloud.pixels.T, cloud.inverse_depth, *cloud.slope.T]), cloud.source
    if every > 1:
        column, row = (axis.astype(np.int32) % every for axis in columns[:2])
        chosen = np.append(
            np.flatnonzero((column == every // 2) & (row == every // 2)), NO_INDEX
        ).astype(np.int32)
        columns, source = np.take(columns, chosen[:-1], axis=1), source[chosen[:-1]]
    rasterise_views(
        columns,
        source,
        a.astype(np.float32),
        b.astype(np.float32),
        every * HALF_PX,
        inverse_depth,
        winner,
    )
    return inverse_depth, winner if every == 1 else chosen[winner]


def projections(
    source: Source,
    world_from_cam: FloatArray,  # [F, 4, 4]
    camera: Intrinsics,
) -> tuple[FloatArray, FloatArray]:
    """A [F, 3, 3] and b [F, 3] that take (u, v, 1) and inverse depth of the source to the cameras'
    pixels.
    """
    cam_from_source = se3.inverse(world_from_cam) @ source.world_from_source
    a = camera.matrix @ cam_from_source[..., :3, :3] @ np.linalg.inv(source.camera.matrix)
    return a, cam_from_source[..., :3, 3] @ camera.matrix.T


def source_pixels(
    source: Source,
    inverse_depth: FloatArray,  # [H, W] in the view, 0 = infinitely far
    world_from_cam: FloatArray,  # [4, 4]
    camera: Intrinsics,
) -> tuple[FloatArray, FloatArray]:
    """Pixels [H, W, 2] float32 of the source that show the view's surface, and the depth ratio
    source / view [H, W].

    The ratio is the magnification of surfaces that face the camera; it is not positive for what
    lies behind the source.
    """
    source_from_cam = se3.inverse(source.world_from_source) @ world_from_cam
    return Epipolar.of(camera, source_from_cam, source.camera).project(inverse_depth)


def slopes(inverse_depth: FloatArray) -> FloatArray:
    """The step of the surface per pixel along u and v [H, W, 2]; inverse depth [H, W] is NaN where
    it is unknown.
    """
    found = np.empty((*inverse_depth.shape, 2), inverse_depth.dtype)
    tops = range(0, len(inverse_depth), BAND_ROWS)
    parallel_map(
        lambda top: _slopes(inverse_depth, top, min(top + BAND_ROWS, len(found)), found), tops
    )
    return found


@numba.njit(nogil=True, cache=True)
def _slopes(
    q: FloatArray,  # [H, W]
    top: int,  # the first row
    bottom: int,  # behind the last row
    found: FloatArray,  # [H, W, 2], these rows written; 0 where neither side goes on straight
) -> None:
    """A pixel at an edge belongs to the side whose next step continues the slope; of two such sides
    to the flatter.
    """
    for row in range(top, bottom):
        for column in range(q.shape[1]):
            for axis in range(2):
                along, size = (column, q.shape[1]) if axis == 0 else (row, q.shape[0])
                flattest = np.inf
                for side in (1, -1):
                    if not 0 <= along + side < size:
                        continue
                    du, dv = (side, 0) if axis == 0 else (0, side)
                    near = side * (q[row + dv, column + du] - q[row, column])
                    straight = False
                    if 0 <= along + 2 * side < size:
                        beyond = side * (
                            q[row + 2 * dv, column + 2 * du] - q[row + dv, column + du]
                        )
                        straight = abs(beyond - near) <= STRAIGHT * abs(near)
                    if (straight or abs(near) <= FLAT * q[row, column]) and abs(near) < abs(
                        flattest
                    ):
                        flattest = near
                found[row, column, axis] = flattest if np.isfinite(flattest) else 0.0


def depths(
    inverse_depth: FloatArray,  # [...]
    covered: BoolArray,  # [...]
) -> FloatArray:
    """Depths [...] as Views have them: inf where the inverse is 0, 0 where not covered."""
    with np.errstate(divide="ignore"):
        return np.where(covered, 1 / np.where(covered, inverse_depth, 1), 0).astype(np.float32)
