"""Depth maps fused into a truncated signed distance volume, rendered by ray casting (Curless &
Levoy 1996).

Open3D's sparse voxel blocks hold the volume. Its unit is the median depth of the last observed
frame, its frame that frame's camera, so that neither the poses' unit nor a far-off world frame
matters. Whatever is farther than the volume reaches lies on a far plane and keeps the last frame's
image.
"""

from dataclasses import dataclass
from typing import Any, Self

import cv2
import numpy as np
import open3d as o3d

from geovp_classic.geometry import se3
from geovp_classic.interfaces import Inpainter
from geovp_classic.rendering import patches
from geovp_classic.rendering.image_sampler import resampled, warp
from geovp_classic.rendering.patches import Source
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics, Views

BLOCK_VOXELS = 8  # along each side of a block
FIRST_BLOCKS = 8192  # the volume grows beyond by itself
TRUNCATION_VOXELS = (
    16.0  # along a ray that grazes the road the distance to it grows by so much from voxel to voxel
)
GAP_PX = 16
LEAST_WEIGHT = 0.5  # one frame that saw a surface is enough
NEAREST = 0.01  # median depths; surfaces nearer than this are not cast
FRAGMENT_STEP = 8  # pixels per cell of the map of ranges along which rays are cast
WARM_UP_STEP = 2  # see Volume.warmed_up
# farther than the volume reaches from the last frame, that rays reach from a pose that backs up
BEHIND = 2.0


@dataclass(frozen=True)
class Volume:
    """A filled volume; `reach` and the grid are in units of `unit`, which is in the poses' own."""

    grid: Any  # open3d.t.geometry.VoxelBlockGrid
    world_from_volume: FloatArray  # [4, 4]
    unit: float
    reach: float

    def warmed_up(self, camera: Intrinsics) -> Self:
        """This volume, once Open3D has made room for its map of ranges.

        Whenever a cast needs more room than all before it, Open3D 0.20 makes that room but leaves
        the image full of holes. A cast with far more cells than later ones need is thrown away
        here, so that these are whole.
        """
        self.cast(self.world_from_volume, camera, WARM_UP_STEP)
        return self

    def cast(
        self,
        world_from_cam: FloatArray,  # [4, 4]
        camera: Intrinsics,
        step_px: int = FRAGMENT_STEP,
    ) -> tuple[FloatArray, FloatArray]:
        """Colour [H, W, 3] in [0, 1], 0 for none, and inverse depth [H, W] of the nearest surface,
        NaN for none.
        """
        volume_from_cam = _scaled(
            se3.inverse(self.world_from_volume) @ world_from_cam, 1 / self.unit
        )
        with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
            seen = self.grid.ray_cast(
                self.grid.hashmap().key_tensor()[
                    self.grid.hashmap().active_buf_indices().to(o3d.core.int64)
                ],
                o3d.core.Tensor.from_numpy(camera.matrix),
                o3d.core.Tensor.from_numpy(se3.inverse(volume_from_cam)),
                camera.width_px,
                camera.height_px,
                ["depth", "color"],
                1.0,
                NEAREST,
                BEHIND * self.reach,
                LEAST_WEIGHT,
                TRUNCATION_VOXELS,
                step_px,
            )
        depth = seen["depth"].numpy()[..., 0]
        return seen["color"].numpy(), np.where(
            depth > 0, 1 / (self.unit * np.where(depth > 0, depth, 1)), np.nan
        )


@dataclass(frozen=True)
class VolumeScene:
    """A volume with the last observed frame, whose colours are read where it shows the volume's
    surface.
    """

    volume: Volume
    last: Source
    # [H, W] float32, inverse, of the last frame; what is beyond the volume is a backdrop
    last_depth: FloatArray
    agreement: float
    inpainter: Inpainter

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        """The volume from the poses [F, 4, 4], behind it the far plane; uncovered where there is
        neither.
        """
        seen = [self._view_one(pose, intrinsics) for pose in world_from_cam]
        frames, covered, depths = (np.stack(maps) for maps in zip(*seen, strict=True))
        return Views(
            self.inpainter.inpaint(
                Views(frames, covered, depths), resampled(self.last, intrinsics)
            ),
            covered,
            depths,
        )

    def _view_one(
        self, world_from_cam: FloatArray, camera: Intrinsics
    ) -> tuple[ByteArray, BoolArray, FloatArray]:
        """Frame, coverage and depth from one pose."""
        colours, inverse_depth = self.volume.cast(world_from_cam, camera)
        inverse_depth = close_gaps(inverse_depth, GAP_PX)
        solid, coloured = np.isfinite(inverse_depth), (colours > 0).any(axis=-1)
        frame = np.clip(255 * colours + 0.5, 0, 255).astype(np.uint8)
        near, near_shown, _ = self._from_last(
            np.where(solid, inverse_depth, 0), world_from_cam, camera
        )
        far, far_shown, there = self._from_last(np.zeros(solid.shape), world_from_cam, camera)
        is_far = ~solid & far_shown & (there * self.volume.unit * self.volume.reach <= 1)
        is_last = solid & near_shown
        frame[is_last], frame[is_far] = near[is_last], far[is_far]
        covered = is_far | (solid & (coloured | is_last))
        depths = np.where(
            covered, patches.depths(np.where(is_far, 0, inverse_depth), covered), np.float32(0)
        )
        return np.where(covered[..., None], frame, np.uint8(0)), covered, depths

    def _from_last(
        self, inverse_depth: FloatArray, world_from_cam: FloatArray, camera: Intrinsics
    ) -> tuple[ByteArray, BoolArray, FloatArray]:
        """Colours [H, W, 3] of the last frame for surfaces at the view's inverse depth [H, W], and
        its own depth there.

        In between, where it shows them [H, W]: neither beside its image nor behind its own
        surfaces.
        """
        colours, shown, pixels, ratio = warp(self.last, inverse_depth, world_from_cam, camera)
        u, v = np.moveaxis(np.where(shown[..., None], pixels, np.float32(0)), -1, 0)
        there = np.asarray(cv2.remap(self.last_depth, u, v, cv2.INTER_NEAREST), np.float32)
        in_front = inverse_depth / np.where(shown, ratio, 1) >= there * (1 - self.agreement)
        return colours, shown & (in_front | (inverse_depth == 0)), there


def close_gaps(
    inverse_depth: FloatArray,  # [H, W], NaN where no surface was found
    gap_px: int,
) -> FloatArray:
    """Gaps of at most `gap_px` in a column become the plane between their upper and lower border.

    Rays that graze the road slip between the voxels that hold it; inverse depth is linear on a
    plane.
    """
    known = np.isfinite(inverse_depth)
    row = np.arange(len(inverse_depth))[:, None]
    above = np.maximum.accumulate(np.where(known, row, -1), axis=0)
    below = np.minimum.accumulate(np.where(known, row, len(row))[::-1], axis=0)[::-1]
    narrow = ~known & (above >= 0) & (below < len(row)) & (below - above - 1 <= gap_px)
    above, below = np.where(narrow, above, 0), np.where(narrow, below, 1)
    upper, lower = (
        np.take_along_axis(inverse_depth, above, 0),
        np.take_along_axis(inverse_depth, below, 0),
    )
    return np.where(
        narrow, upper + (lower - upper) * (row - above) / (below - above), inverse_depth
    )


def integrate(
    frames: ByteArray,  # [P, H, W, 3]
    inverse_depths: FloatArray,  # [P, H, W]
    known: BoolArray,  # [P, H, W]
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    voxel_px: float,  # its edge, in pixels at the last frame's median depth
    reach: float,  # the farthest depth that goes into the volume, in median depths
) -> Volume:
    """The volume of all known pixels nearer than `reach`."""
    core = o3d.core
    near = inverse_depths[-1][known[-1] & (inverse_depths[-1] > 0)]
    unit = 1 / float(np.median(near)) if len(near) else 1.0
    voxel = voxel_px / camera.fx_px
    kinds, channels = (core.float32,) * 3, [core.SizeVector([count]) for count in (1, 1, 3)]
    grid = o3d.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight", "color"), kinds, channels, voxel, BLOCK_VOXELS, FIRST_BLOCKS
    )
    matrix = core.Tensor.from_numpy(camera.matrix)
    cam_from_last = se3.inverse(world_from_cam) @ world_from_cam[-1]
    for frame, inverse, good, pose in zip(
        frames, inverse_depths, known, cam_from_last, strict=True
    ):
        used = good & (inverse * unit > 1 / reach)
        if not used.any():
            continue
        depth = np.where(used, 1 / (unit * np.where(used, inverse, 1)), 0).astype(np.float32)
        image = o3d.t.geometry.Image(np.ascontiguousarray(frame / np.float32(255)))
        depth_map = o3d.t.geometry.Image(np.ascontiguousarray(depth[..., None]))
        extrinsic = core.Tensor.from_numpy(_scaled(pose, 1 / unit))
        blocks = grid.compute_unique_block_coordinates(
            depth_map, matrix, extrinsic, 1.0, reach, TRUNCATION_VOXELS
        )
        grid.integrate(
            blocks, depth_map, image, matrix, matrix, extrinsic, 1.0, reach, TRUNCATION_VOXELS
        )
    return Volume(grid, world_from_cam[-1], unit, reach).warmed_up(camera)


def _scaled(b_from_a: FloatArray, factor: float) -> FloatArray:
    """The same motion in another unit of length."""
    return se3.compose(b_from_a[..., :3, :3], factor * b_from_a[..., :3, 3])
