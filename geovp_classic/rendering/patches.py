"""Observed pixels as small flat patches in space (surfels; Pfister et al. 2000).

A patch is what one pixel of a source image shows: the square around it, at its inverse depth and
with the slope of its surface, so that approached surfaces neither tear nor lose their planes.
Inverse depth 0 is infinitely far and needs no special case.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.parallel import parallel_map
from geovp_classic.rendering.rasterizer import NO_INDEX, IndexArray, rasterise_view
from geovp_classic.rendering.source import Source
from geovp_classic.types import BoolArray, FloatArray, Intrinsics


class Patches(NamedTuple):
    """N pixels of several sources with their place in space."""

    pixels: FloatArray  # [N, 2] float32, (u, v) in their source
    inverse_depth: FloatArray  # [N] float32
    slope: FloatArray  # [N, 2] float32, of the inverse depth per pixel along u and v
    source: IndexArray  # [N], index of the source


def concatenate(clouds: Sequence[Patches]) -> Patches:
    """Concatenate clouds; where patches are equally near, earlier ones are rendered."""
    return Patches(*map(np.concatenate, zip(*clouds, strict=True)))


@dataclass(frozen=True)
class PatchModel:
    """Conversion of depth maps to patches, and their rasterisation."""

    # Half the side of a patch. At .5 they tile a plane; overlap closes cracks on curved surfaces.
    half_px: float = 0.52
    # A surface is straight where its next step differs by less than this fraction. Set by hand: at
    # an edge one step is many times the next.
    max_step_change: float = 0.5
    # A step of less than this fraction of the inverse depth is a slope, not an edge. Set by hand, a
    # fifth of the depth difference up to which fusion takes surfaces for one.
    max_smooth_step: float = 0.02
    # Width of a patch in views that are coarser than the sources; smaller ones are thinned. At one
    # pixel of the view, no pixel stays empty.
    coarse_patch_px: float = 1.0

    def from_depth_map(
        self,
        inverse_depth: FloatArray,  # [H, W], 0 = infinitely far
        is_known: BoolArray,  # [H, W]
        source: int,
    ) -> Patches:
        """Return the patches of all known pixels of one image."""
        # Unknown depth is NaN, so that it takes no part in slopes.
        q = np.where(is_known, inverse_depth, np.nan).astype(np.float32)
        rows, columns = np.nonzero(is_known)
        pixels = np.stack([columns, rows], axis=-1).astype(np.float32)
        index = np.full(len(pixels), source, np.int32)
        slopes = np.stack([self._slopes_along_rows(q), self._slopes_along_rows(q.T).T], axis=-1)
        return Patches(pixels, q[is_known], slopes[is_known], index)

    def _slopes_along_rows(self, inverse_depth: FloatArray) -> FloatArray:
        """Return the steps per column [H, W].

        A pixel at an edge belongs to the side whose next step continues its own step; of two such
        sides to the flatter one. Without such a side the slope is 0.
        """
        # With two columns of NaN on either side, column j of the image has the steps j and j + 1 on
        # its left and j + 2 and j + 3 on its right.
        padded = np.pad(inverse_depth, ((0, 0), (2, 2)), constant_values=np.nan)
        steps = np.diff(padded, axis=1)
        far_left, near_left, near_right, far_right = (
            steps[:, first : first + inverse_depth.shape[1]] for first in range(4)
        )
        left = self._straight(near_left, far_left, inverse_depth)
        right = self._straight(near_right, far_right, inverse_depth)
        flatter = np.where(np.abs(right) <= np.abs(left), right, left)
        return np.where(np.isfinite(flatter), flatter, 0)

    def _straight(
        self, step: FloatArray, next_step: FloatArray, inverse_depth: FloatArray
    ) -> FloatArray:
        """Return the steps [H, W] to the pixels on one side, infinite across an edge."""
        size = np.abs(step)
        is_straight = np.abs(next_step - step) <= self.max_step_change * size
        is_smooth = size <= self.max_smooth_step * inverse_depth
        return np.where(is_straight | is_smooth, step, np.inf)

    def rasterise(
        self,
        cloud: Patches,
        sources: Sequence[Source],
        world_from_cam: FloatArray,  # [F, 4, 4]
        camera: Intrinsics,
    ) -> tuple[FloatArray, IndexArray]:
        """Return the inverse depth [F, H, W] of the nearest patch at each pixel, and its number.

        Pixels without a patch have inverse depth -1 and number NO_INDEX.
        """
        # Thinning: in coarse views one patch of stride x stride pixels stands for all of them.
        source_px = sources[0].camera.fx_px / camera.fx_px  # pixels of a source per pixel
        stride = max(1, int(self.coarse_patch_px * source_px))
        used = np.arange(len(cloud.source))
        if stride > 1:
            is_used = cloud.pixels.astype(int) % stride == stride // 2
            used = np.flatnonzero(is_used.all(axis=1))
        patches = tuple(values[used] for values in cloud)
        size = (len(world_from_cam), camera.height_px, camera.width_px)
        z_buffer = np.full(size, -1, np.float32)
        winner = np.full(size, NO_INDEX, np.int32)
        half_px = np.float32(stride * self.half_px)

        def rasterise(step: int) -> None:
            # The linear map of each source's (u, v, 1, inverse depth) to homogeneous view pixels.
            cam_from_world = se3.inverse(world_from_cam[step])
            to_view = []
            for source in sources:
                cam_from_source = cam_from_world @ source.world_from_source
                maps = Epipolar.of(source.camera, cam_from_source, camera)
                to_view.append(np.column_stack([maps.infinity, maps.epipole]))
            rasterise_view(
                patches,
                np.stack(to_view),
                half_px,
                z_buffer[step],
                winner[step],
            )

        parallel_map(rasterise, range(len(world_from_cam)))
        if stride > 1:
            # Numbers among the used patches become numbers in the cloud. NO_INDEX is -1 and stays,
            # as the last entry.
            winner = np.append(used, NO_INDEX).astype(np.int32)[winner]
        return z_buffer, winner


def depths(
    inverse_depth: FloatArray,  # [...]
    covered: BoolArray,  # [...]
) -> FloatArray:
    """Return depths [...] float32: infinite where the inverse is 0, and 0 where not covered."""
    with np.errstate(divide="ignore"):
        depth = 1 / np.where(covered, inverse_depth, 1)
    return np.where(covered, depth, 0).astype(np.float32)
