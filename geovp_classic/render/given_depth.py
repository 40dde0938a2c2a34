"""The last observed frame on its recorded depth: what the best possible depth of one frame could show."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Fill
from geovp_classic.render import backward, patches
from geovp_classic.render.fill import Blank
from geovp_classic.render.image_sampler import observed
from geovp_classic.render.outlines import Outlines, outlines
from geovp_classic.render.rasterizer import NOTHING, IndexArray
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
        last = patches.Source(context.frames[-1], context.intrinsics, past.world_from_cam[-1])
        cloud = patches.patches(inverse_depth, np.isfinite(inverse_depth), 0)
        return SurfaceScene(last, cloud, outlines(inverse_depth, context.intrinsics), self.fill)


@dataclass(frozen=True)
class SurfaceScene:
    """One frame whose every pixel is a small flat patch in space."""

    last: patches.Source
    cloud: patches.Patches
    outlines: Outlines
    fill: Fill

    def view(self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics) -> Views:
        """The surface from the poses [F, 4, 4].

        Uncovered where the last frame does not show what would be seen, which is filled, and where it shows a mixture
        of two surfaces that have parted since: that is rendered, a better guess than any fill's, but not vouched for.
        """
        rendered, winner = patches.draw(self.cloud, [self.last], world_from_cam, intrinsics)
        last_from_cam = se3.inverse(self.last.world_from_source) @ world_from_cam
        parts = [self._view_one(*one, intrinsics) for one in zip(rendered, winner, last_from_cam, strict=True)]
        frames, depths, shown, mixed = (np.stack(maps) for maps in zip(*parts, strict=True))
        filled = self.fill.fill(Views(frames, shown, depths), observed(self.last, intrinsics))
        return Views(filled, shown & ~mixed, depths)

    def _view_one(
        self, inverse_depth: FloatArray, winner: IndexArray, last_from_cam: FloatArray, intrinsics: Intrinsics
    ) -> tuple[ByteArray, FloatArray, BoolArray, BoolArray]:
        """Frame [H, W, 3], depth [H, W], what is shown [H, W], and where parted surfaces mix [H, W]."""
        seen = winner != NOTHING
        pixels = backward.source_pixels(
            last_from_cam, np.where(seen, inverse_depth, np.nan), intrinsics, self.last.camera
        )
        shown = seen & backward.inside(pixels, self.last.camera)
        frame = np.where(shown[..., None], backward.sample(self.last.frame, pixels), np.uint8(0))
        mixed = np.zeros(seen.shape, dtype=bool)
        columns, rows = self.cloud.pixels[winner[seen]].astype(int).T
        mixed[seen] = self.outlines.parted(se3.inverse(last_from_cam), intrinsics)[rows, columns]
        return frame, patches.depths(inverse_depth, shown), shown, mixed
