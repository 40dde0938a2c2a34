"""The last observed frame on its recorded depth: what the best possible depth of one frame could show."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import Fill
from geovp_classic.render import backward, patches, rasterizer, splat
from geovp_classic.render.fill import Blank
from geovp_classic.render.image_sampler import observed
from geovp_classic.render.outlines import Outlines, outlines
from geovp_classic.types import BoolArray, ByteArray, Context, FloatArray, Grant, Intrinsics, Trajectory, Views


@dataclass(frozen=True)
class GivenDepth:
    """The recorded depth of the last frame, drawn with a z-buffer; colours are read backward from the frame, once."""

    fill: Fill = field(default_factory=Blank)

    @property
    def needs(self) -> Grant:
        """The recorded past depths."""
        return Grant.PAST_DEPTHS

    def reconstruct(self, context: Context, past: Trajectory) -> SurfaceScene:
        """The last frame's visible surface; Incompatible when the clip has no depth or the poses are not metric."""
        if context.past_depths is None:
            raise Incompatible("given-depth needs recorded depth, the clip has none: choose a renderer without it")
        if not past.is_metric:
            raise Incompatible("recorded depth is in metres, the poses are not: give the odometry a scale")
        depth = context.past_depths[-1]
        if not (depth >= 0).all():
            raise BadData("recorded depth has negative numbers or NaN: write 0 where it is unknown, inf for the sky")
        inverse_depth = np.where(depth > 0, 1 / np.where(depth > 0, depth.astype(np.float64), 1), np.nan)
        return SurfaceScene(
            frame=context.frames[-1],
            camera=context.intrinsics,
            world_from_last=past.world_from_cam[-1],
            patches_last=_patches(inverse_depth, context.intrinsics),
            pixels=np.flatnonzero(np.isfinite(inverse_depth)),
            outlines=outlines(inverse_depth, context.intrinsics),
            fill=self.fill,
        )


@dataclass(frozen=True)
class SurfaceScene:
    """One frame whose every pixel is a small flat patch in space."""

    frame: ByteArray  # [H, W, 3]
    camera: Intrinsics
    world_from_last: FloatArray  # [4, 4]
    patches_last: FloatArray  # [N, 4, 4], homogeneous corners in the last camera's frame
    pixels: splat.IndexArray  # [N], the frame's pixel that each patch is, row by row
    outlines: Outlines
    fill: Fill

    def view(self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics) -> Views:
        """The surface from the poses [F, 4, 4].

        Uncovered where the last frame does not show what would be seen, which is filled, and where it shows a mixture
        of two surfaces that have parted since: that is drawn, a better guess than any fill's, but not vouched for.
        """
        last_from_cam = se3.inverse(self.world_from_last) @ world_from_cam
        drawn = (self._view_one(one, intrinsics) for one in last_from_cam)
        frames, inverse_depths, mixed = (np.stack(maps) for maps in zip(*drawn, strict=True))
        shown = np.isfinite(inverse_depths)
        views = Views(frames, shown, splat.depths(inverse_depths, shown))
        last = observed(patches.Source(self.frame, self.camera, self.world_from_last), intrinsics)
        return Views(self.fill.fill(views, last), shown & ~mixed, views.depths)

    def _view_one(self, last_from_cam: FloatArray, intrinsics: Intrinsics) -> tuple[ByteArray, FloatArray, BoolArray]:
        """Frame [H, W, 3], inverse depth [H, W], NaN where nothing is seen, and where parted surfaces mix [H, W]."""
        cam_from_last = se3.inverse(last_from_cam)
        inverse_depth, winner = splat.draw(self.patches_last @ cam_from_last.T, intrinsics)
        seen = winner != splat.NOTHING
        inverse_depth = np.where(seen, inverse_depth, np.nan)
        source = backward.source_pixels(last_from_cam, inverse_depth, intrinsics, self.camera)
        shown = backward.inside(source, self.camera)
        frame = np.where(shown[..., None], backward.sample(self.frame, source), np.uint8(0))
        mixed = np.zeros(seen.shape, dtype=bool)
        mixed[seen] = self.outlines.parted(cam_from_last, intrinsics).ravel()[self.pixels[winner[seen]]]
        return frame, np.where(shown, inverse_depth, np.nan), mixed


def _patches(inverse_depth: FloatArray, camera: Intrinsics) -> FloatArray:
    """The corners [N, 4, 4] of the patches of all pixels whose inverse depth [H, W] is known (not NaN)."""
    known = np.isfinite(inverse_depth)
    offsets = rasterizer.HALF_PX * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corners_px = pinhole.pixel_grid(camera)[known][:, None] + offsets
    corners_q = np.maximum(inverse_depth[known][:, None] + patches.slopes(inverse_depth)[known] @ offsets.T, 0.0)
    rays = pinhole.unproject(corners_px, np.ones(corners_q.shape), camera)
    return np.concatenate([rays, corners_q[..., None]], axis=-1)
