"""Depth maps fused into a truncated signed distance volume, rendered by ray casting (Curless &
Levoy 1996).

Open3D's sparse voxel blocks hold the volume. Its unit is the median depth of the last observed
frame, its frame that frame's camera, so that neither the poses' unit nor a far-off world frame
matters. Surfaces beyond its reach lie on a far plane, which shows the last frame.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import open3d as o3d

from geovp_classic.depth.multiview import Multiview
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.interfaces import DepthSource, Inpainter
from geovp_classic.observation import observations_of, recent
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.rendering import patches
from geovp_classic.rendering.inpainting import inpainted_views
from geovp_classic.rendering.source import Source, resampled, to_bytes, warp
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
    Views,
)


@dataclass(frozen=True)
class Volume:
    """A filled volume in its own unit of length."""

    grid: Any  # open3d.t.geometry.VoxelBlockGrid
    world_from_volume: FloatArray  # [4, 4]
    unit: float  # in the poses' unit
    settings: "VolumeSettings"

    def cast(
        self,
        world_from_cam: FloatArray,  # [4, 4]
        camera: Intrinsics,
        cell_px: int | None = None,  # of the map of depth ranges; None: as in the settings
    ) -> tuple[FloatArray, FloatArray]:
        """Cast rays and return colours [H, W, 3] in [0, 1] and inverse depth [H, W].

        Where no surface is hit, colours are 0 and the inverse depth is NaN.
        """
        settings = self.settings
        hash_map = self.grid.hashmap()
        active = hash_map.active_buf_indices().to(o3d.core.int64)
        blocks = hash_map.key_tensor()[active]
        cam_from_volume = se3.inverse(world_from_cam) @ self.world_from_volume
        with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
            maps = self.grid.ray_cast(
                blocks,
                o3d.core.Tensor.from_numpy(camera.matrix),
                o3d.core.Tensor.from_numpy(_scaled(cam_from_volume, 1 / self.unit)),
                camera.width_px,
                camera.height_px,
                ["depth", "color"],
                1.0,
                settings.min_depth,
                settings.max_depth_reaches * settings.reach,
                settings.min_weight,
                settings.truncation_voxels,
                cell_px or settings.cell_px,
            )
        depth = maps["depth"].numpy()[..., 0]
        is_hit = depth > 0
        inverse_depth = 1 / (self.unit * np.where(is_hit, depth, 1))
        return maps["color"].numpy(), np.where(is_hit, inverse_depth, np.nan)


@dataclass(frozen=True)
class VolumeSettings:
    """Resolution and extent of a volume; lengths are in median depths of the last frame."""

    voxel_px: float = 2.5  # edge of a voxel, as seen at the median depth; set by hand
    # Surfaces farther away lie on a far plane. Voxels are half a pixel wide there.
    reach: float = 5.0
    min_depth: float = 0.01  # of a surface that is cast: the camera's own place
    # A camera that backs up is farther from the volume, by up to its reach.
    max_depth_reaches: float = 2.0
    # On a ray that grazes the road, the distance to it changes by so many voxels from one to the
    # next.
    truncation_voxels: float = 16.0
    min_weight: float = 0.5  # one frame that shows a surface is enough
    block_voxels: int = 8  # along each side of a block; Open3D's default is 16
    num_blocks: int = 8192  # at first; the volume grows
    cell_px: int = 8  # of the map of depth ranges along which rays are cast; Open3D's default

    def __post_init__(self) -> None:
        if not 0 < self.reach < 2 * self.voxel_px + 1:
            raise BadData(
                f"reach is {self.reach} and voxel_px {self.voxel_px}, expected a reach between 0 "
                "and 2 voxel_px + 1"
            )

    def integrate(
        self,
        frames: ByteArray,  # [P, H, W, 3]
        inverse_depths: FloatArray,  # [P, H, W]
        is_known: BoolArray,  # [P, H, W]
        camera: Intrinsics,
        world_from_cam: FloatArray,  # [P, 4, 4]
    ) -> Volume:
        """Return the volume of all known pixels within reach."""
        core = o3d.core
        # The unit is the median depth of the last frame.
        last = inverse_depths[-1]
        is_near = is_known[-1] & (last > 0)
        unit = 1 / float(np.median(last[is_near])) if is_near.any() else 1.0
        channels = [core.SizeVector([count]) for count in (1, 1, 3)]
        grid = o3d.t.geometry.VoxelBlockGrid(
            ("tsdf", "weight", "color"),
            (core.float32,) * 3,
            channels,
            self.voxel_px / camera.fx_px,
            self.block_voxels,
            self.num_blocks,
        )
        matrix = core.Tensor.from_numpy(camera.matrix)
        cam_from_last = se3.inverse(world_from_cam) @ world_from_cam[-1]
        for step, frame in enumerate(frames):
            # Surfaces beyond the reach have depth 0, which Open3D ignores.
            is_used = is_known[step] & (inverse_depths[step] * unit > 1 / self.reach)
            if not is_used.any():
                continue
            safe = np.where(is_used, inverse_depths[step], 1)
            depth = np.where(is_used, 1 / (unit * safe), 0)
            depth_map = _image(depth[..., None])
            extrinsic = core.Tensor.from_numpy(_scaled(cam_from_last[step], 1 / unit))
            limits = (1.0, self.reach, self.truncation_voxels)
            blocks = grid.compute_unique_block_coordinates(depth_map, matrix, extrinsic, *limits)
            image = _image(frame / 255)
            grid.integrate(blocks, depth_map, image, matrix, matrix, extrinsic, *limits)
        volume = Volume(grid, world_from_cam[-1], unit, self)
        # Open3D 0.20 leaves holes in any cast that needs a larger map of ranges than all before
        # it. A first cast with many more cells than later ones need is therefore thrown away.
        volume.cast(world_from_cam[-1], camera, cell_px=2)
        return volume


@dataclass(frozen=True)
class VolumeFusion:
    """All observed frames in one truncated signed distance volume that is ray-cast.

    Depths are in median depths of the last frame, so that any unit of the poses will do. Surfaces
    are averaged over frames and smooth over voxels; colours are the last frame's where it shows
    them, else the voxels'. Open3D's threads take blocks in any order: up to one pixel in ten
    thousand differs from run to run.
    """

    depth: DepthSource = Multiview()
    inpainter: Inpainter = DetailTransfer()
    volume: VolumeSettings = VolumeSettings()
    num_frames: int = 10  # the last usable ones: one second at KITTI's 10 Hz
    # Relative; the last frame shows a surface up to this difference of inverse depths. Set by hand,
    # three times that of depth fusion: voxels move surfaces.
    max_depth_difference: float = 0.3
    # Up to which gaps in a column are closed. Set by hand: six voxels at the median depth.
    gap_px: int = 16

    def __post_init__(self) -> None:
        if self.num_frames < 1:
            raise BadData(f"num_frames is {self.num_frames}, expected 1 or more observed frames")
        if not 0 < self.max_depth_difference < 1:
            raise BadData(
                f"max_depth_difference is {self.max_depth_difference}, expected a fraction "
                "between 0 and 1"
            )

    @property
    def needs(self) -> PrivilegedInput:
        """Return the privileged inputs of the depth source."""
        return self.depth.needs

    @single_threaded_blas
    def reconstruct(self, context: Context, past: Trajectory) -> "VolumeScene":
        """Return the volume of the last frames, in the world frame and the unit of the past."""
        context, past = recent(context.only(self.needs), past, "crop", self.num_frames)
        inverse_depths, confidence = self.depth.inverse_depths(context, past)
        is_known = confidence > 0
        is_known[-1] = True  # the last frame's depth map has no holes
        is_known &= ~observations_of(context, "crop").mask
        poses = past.world_from_cam
        volume = self.volume.integrate(
            context.frames, inverse_depths, is_known, context.intrinsics, poses
        )
        last = Source(context.frames[-1], context.intrinsics, poses[-1])
        return VolumeScene(volume, last, inverse_depths[-1].astype(np.float32), self)


@dataclass(frozen=True)
class VolumeScene:
    """A volume with the last observed frame, whose colours replace those of the voxels it shows."""

    volume: Volume
    last: Source
    last_inverse_depth: FloatArray  # [H, W] float32, inverse, of the last frame
    renderer: VolumeFusion

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Return the views of the volume and the far plane from the poses [F, 4, 4]."""
        views = [self._view(pose, intrinsics) for pose in world_from_cam]
        return inpainted_views(views, self.renderer.inpainter, resampled(self.last, intrinsics))

    def _view(
        self, world_from_cam: FloatArray, camera: Intrinsics
    ) -> tuple[ByteArray, BoolArray, FloatArray]:
        """Return frame, coverage and depth from one pose."""
        colours, inverse_depth = self.volume.cast(world_from_cam, camera)
        inverse_depth = close_gaps(inverse_depth, self.renderer.gap_px)
        is_solid = np.isfinite(inverse_depth)
        # Pixels without a surface may lie on the far plane.
        shown_inverse_depth = np.where(is_solid, inverse_depth, 0)
        # Where the last frame shows the surfaces: neither outside of its image, nor behind its own
        # surfaces. Its own ones may lie beyond the volume.
        last_colours, is_inside, pixels, ratio = warp(
            self.last, shown_inverse_depth, world_from_cam, camera
        )
        u, v = cv2.split(pixels)
        recorded = cv2.remap(self.last_inverse_depth, u, v, cv2.INTER_NEAREST)
        seen_from_last = shown_inverse_depth / np.where(is_inside, ratio, 1)
        is_in_front = seen_from_last >= recorded * (1 - self.renderer.max_depth_difference)
        is_shown = is_inside & (is_in_front | (shown_inverse_depth == 0))
        is_beyond = recorded * self.volume.unit * self.volume.settings.reach <= 1
        # The last frame has the sharpest colours; voxels show what it does not.
        is_last = is_shown & (is_solid | is_beyond)
        is_voxel = is_solid & (colours > 0).any(axis=-1)
        covered = is_last | is_voxel
        frame = to_bytes(255 * colours)
        frame[is_last] = last_colours[is_last]
        frame[~covered] = 0
        return frame, covered, patches.depths(shown_inverse_depth, covered)


def close_gaps(
    inverse_depth: FloatArray,  # [H, W], NaN where no surface was hit
    gap_px: int,
) -> FloatArray:
    """Close gaps of at most `gap_px` in a column with the plane between their borders.

    Rays that graze the road slip between the voxels that hold it; inverse depth is linear on a
    plane.
    """
    # The next rows above and below each pixel that hit a surface.
    is_hit = np.isfinite(inverse_depth)
    row = np.arange(len(inverse_depth))[:, None]
    num_rows = len(row)
    hit_row = np.where(is_hit, row, -1)
    above = np.maximum.accumulate(hit_row, axis=0)
    hit_row = np.where(is_hit, row, num_rows)
    below = np.minimum.accumulate(hit_row[::-1], axis=0)[::-1]
    is_between = ~is_hit & (above >= 0) & (below < num_rows)
    is_narrow = is_between & (below - above <= gap_px + 1)
    # Linear interpolation between them, in narrow gaps.
    above = np.where(is_narrow, above, 0)
    below = np.where(is_narrow, below, 1)
    upper = np.take_along_axis(inverse_depth, above, 0)
    lower = np.take_along_axis(inverse_depth, below, 0)
    fraction = (row - above) / (below - above)
    plane = upper + fraction * (lower - upper)
    return np.where(is_narrow, plane, inverse_depth)


def _image(values: FloatArray) -> Any:
    return o3d.t.geometry.Image(np.ascontiguousarray(values, np.float32))


def _scaled(b_from_a: FloatArray, factor: float) -> FloatArray:
    """Return the same motion in another unit of length."""
    return se3.compose(b_from_a[..., :3, :3], factor * b_from_a[..., :3, 3])
