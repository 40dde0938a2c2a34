"""The last observed frame on its recorded depth, an upper bound for depth from one frame."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.depth.given import Given
from geovp_classic.geometry import se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.interfaces import Inpainter
from geovp_classic.rendering import patches
from geovp_classic.rendering.depth_edges import separated_edges
from geovp_classic.rendering.inpainting import inpainted_views
from geovp_classic.rendering.patches import Patches, PatchModel
from geovp_classic.rendering.rasterizer import NO_INDEX, IndexArray
from geovp_classic.rendering.source import Source, resampled, warp
from geovp_classic.types import (
    BoolArray,
    Context,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
    Views,
)


@dataclass(frozen=True)
class GivenDepth:
    """Recorded depth of the last frame in a z-buffer; colours are sampled from the frame."""

    inpainter: Inpainter = DetailTransfer()
    patch_model: PatchModel = PatchModel()
    # A pixel that shows two surfaces is uncovered once they are so far apart, or overlap so much.
    min_gap_px: float = 1.0

    needs = PrivilegedInput.PAST_DEPTHS

    def reconstruct(self, context: Context, past: Trajectory) -> "SurfaceScene":
        """Return the last frame's visible surface.

        Raise Incompatible when the clip has no depth or the poses are not metric.
        """
        inverse_depths, confidence = Given().inverse_depths(context, past)
        is_known = confidence[-1] > 0
        inverse_depth = np.where(is_known, inverse_depths[-1], np.nan)
        last = Source(
            context.frames[-1], context.intrinsics, past.world_from_cam[-1]
        )
        cloud = self.patch_model.from_depth_map(inverse_depth, is_known, 0)
        return SurfaceScene(self, last, inverse_depth, cloud)


@dataclass(frozen=True)
class SurfaceScene:
    """One frame, each of whose pixels is a small flat patch in space."""

    settings: GivenDepth
    last: Source
    inverse_depth: FloatArray  # [H, W] of the last frame, NaN where unknown
    cloud: Patches

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Return the views from the poses [F, 4, 4].

        Pixels are uncovered and inpainted where the last frame does not show the surface. Pixels
        that show a mixture of two surfaces, which have separated since, are uncovered but stay: no
        inpainter's guess is better.
        """
        depth_maps, winners = self.settings.patch_model.rasterise(
            self.cloud, [self.last], world_from_cam, intrinsics
        )
        rendered = []
        mixed = []
        for pose, inverse_depth, winner in zip(
            world_from_cam, depth_maps, winners, strict=True
        ):
            is_hit = winner != NO_INDEX
            frame, is_shown, _, _ = warp(
                self.last,
                np.where(is_hit, inverse_depth, np.nan),
                pose,
                intrinsics,
            )
            rendered.append(
                (frame, is_shown, patches.depths(inverse_depth, is_shown))
            )
            mixed.append(self._is_mixed(winner, pose, intrinsics))
        last = resampled(self.last, intrinsics)
        views = inpainted_views(rendered, self.settings.inpainter, last)
        return Views(
            views.frames, views.covered & ~np.stack(mixed), views.depths
        )

    def _is_mixed(
        self,
        winner: IndexArray,
        world_from_cam: FloatArray,
        intrinsics: Intrinsics,
    ) -> BoolArray:
        """Return the pixels [H, W] whose patch shows surfaces that have separated."""
        cam_from_last = (
            se3.inverse(world_from_cam) @ self.last.world_from_source
        )
        epipolar = Epipolar.of(self.last.camera, cam_from_last, intrinsics)
        separated = separated_edges(
            self.inverse_depth,
            epipolar,
            self.settings.min_gap_px,
            self.settings.patch_model,
        )
        is_hit = winner != NO_INDEX
        columns, rows = self.cloud.pixels[winner[is_hit]].astype(int).T
        is_mixed = np.zeros(winner.shape, bool)
        is_mixed[is_hit] = separated[rows, columns]
        return is_mixed
