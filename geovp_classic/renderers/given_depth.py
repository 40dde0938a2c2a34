"""The last observed frame on its recorded depth: what the best possible depth of one frame could
show.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import pinhole, se3
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.interfaces import Inpainter
from geovp_classic.rendering import patches
from geovp_classic.rendering.image_sampler import resampled, warp
from geovp_classic.rendering.rasterizer import NO_INDEX, IndexArray
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    IntArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
    Views,
)

PARTED_PX = 1.0  # surfaces that come this far apart, or closer together, no longer share a pixel
JUMP = 1e-3  # of the inverse depth: a smaller step opens no visible gap
NEAR = 1e-6  # the smallest z of a point that is projected


@dataclass(frozen=True)
class GivenDepth:
    """The recorded depth of the last frame, rasterised with a z-buffer; colours are sampled
    backward from the frame.
    """

    inpainter: Inpainter = field(default_factory=DetailTransfer)

    needs = PrivilegedInput.PAST_DEPTHS  # the recorded past depths

    def reconstruct(self, context: Context, past: Trajectory) -> SurfaceScene:
        """The last frame's visible surface; Incompatible when the clip has no depth or the poses
        are not metric.
        """
        if context.past_depths is None:
            raise Incompatible(
                "given-depth needs recorded depth, the clip has none: choose a renderer without it"
            )
        if not past.is_metric:
            raise Incompatible(
                "recorded depth is in metres, the poses are not: give the odometry a scale"
            )
        depth = context.past_depths[-1]
        if not (depth >= 0).all():
            raise BadData(
                "recorded depth has negative numbers or NaN: write 0 where it is unknown, inf "
                "for the sky"
            )
        inverse_depth = np.where(
            depth > 0, 1 / np.where(depth > 0, depth.astype(np.float64), 1), np.nan
        )
        last = patches.Source(context.frames[-1], context.intrinsics, past.world_from_cam[-1])
        cloud = patches.from_depth_map(inverse_depth, np.isfinite(inverse_depth), 0)
        return SurfaceScene(
            last, cloud, outlines(inverse_depth, context.intrinsics), self.inpainter
        )


@dataclass(frozen=True)
class SurfaceScene:
    """One frame whose every pixel is a small flat patch in space."""

    last: patches.Source
    cloud: patches.Patches
    outlines: Outlines
    inpainter: Inpainter

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        """The surface from the poses [F, 4, 4].

        Uncovered where the last frame does not show the surface, which is filled, and where it
        shows a mixture of two surfaces that have parted since: those pixels are rendered, a better
        guess than any fill's.
        """
        rendered, winner = patches.rasterise(self.cloud, [self.last], world_from_cam, intrinsics)
        last_from_cam = se3.inverse(self.last.world_from_source) @ world_from_cam
        parts = [
            self._view_one(*one, intrinsics)
            for one in zip(rendered, winner, last_from_cam, strict=True)
        ]
        frames, depths, shown, mixed = (np.stack(maps) for maps in zip(*parts, strict=True))
        filled = self.inpainter.inpaint(
            Views(frames, shown, depths), resampled(self.last, intrinsics)
        )
        return Views(filled, shown & ~mixed, depths)

    def _view_one(
        self,
        inverse_depth: FloatArray,
        winner: IndexArray,
        last_from_cam: FloatArray,
        intrinsics: Intrinsics,
    ) -> tuple[ByteArray, FloatArray, BoolArray, BoolArray]:
        """Frame [H, W, 3], depth [H, W], where the last frame shows the surface, and where parted
        surfaces mix.
        """
        hit = winner != NO_INDEX
        world_from_cam = self.last.world_from_source @ last_from_cam
        frame, shown, _, _ = warp(
            self.last, np.where(hit, inverse_depth, np.nan), world_from_cam, intrinsics
        )
        mixed = np.zeros(hit.shape, dtype=bool)
        columns, rows = self.cloud.pixels[winner[hit]].astype(int).T
        mixed[hit] = self.outlines.parted(se3.inverse(last_from_cam), intrinsics)[rows, columns]
        return frame, patches.depths(inverse_depth, shown), shown, mixed


@dataclass(frozen=True)
class Outlines:
    """Neighbouring pixels of one image that do not lie on one plane: either may show a mixture of
    two surfaces.

    While both surfaces move together in the image, the mixture moves with them and stays right;
    once they part, its colour belongs to neither.
    """

    size: tuple[int, int]  # (H, W)
    pairs: IntArray  # [P, 2], numbers of the two pixels, row by row
    # [P, 2, 2, 4], homogeneous: for either pixel of the pair its place, and that on the other's
    # plane
    ends: FloatArray

    def parted(
        self,
        view_from_image: FloatArray,  # [4, 4]
        camera: Intrinsics,
    ) -> BoolArray:
        """The image's pixels [H, W] beside a jump whose two sides the view shows PARTED_PX or more
        differently.
        """
        x, y, z, _ = np.moveaxis(self.ends @ view_from_image.T, -1, 0)
        z = np.maximum(z, NEAR)
        gap_px = np.hypot(
            camera.fx_px * np.diff(x / z, axis=-1), camera.fy_px * np.diff(y / z, axis=-1)
        )  # [P, 2, 1]
        parted = np.zeros(self.size, dtype=bool)
        parted.ravel()[self.pairs[gap_px.min(axis=(1, 2)) >= PARTED_PX]] = True
        return parted


def outlines(
    inverse_depth: FloatArray,  # [H, W], NaN where unknown
    camera: Intrinsics,
) -> Outlines:
    """All pairs of pixels side by side or above one another with a jump between them; none beside
    unknown depth.
    """
    slopes = patches.slopes(inverse_depth).reshape(-1, 2)
    q, numbers = inverse_depth.ravel(), np.arange(inverse_depth.size).reshape(inverse_depth.shape)
    across = np.stack([numbers[:, :-1].ravel(), numbers[:, 1:].ravel()], axis=-1)
    down = np.stack([numbers[:-1].ravel(), numbers[1:].ravel()], axis=-1)
    pairs = np.concatenate([across, down])
    axis = np.repeat([0, 1], [len(across), len(down)])
    first, second = pairs.T
    on_others = np.stack(
        [q[second] - slopes[second, axis], q[first] + slopes[first, axis]], axis=-1
    )  # [P, 2]
    jump = (np.abs(on_others - q[pairs]) > JUMP * q[pairs]).all(axis=-1)
    pairs, on_others = pairs[jump], np.maximum(on_others[jump], 0.0)
    rays = pinhole.rays(camera).reshape(-1, 3)[pairs]  # [P, 2, 3]
    ends = [np.concatenate([rays, depth[..., None]], axis=-1) for depth in (q[pairs], on_others)]
    return Outlines(inverse_depth.shape, pairs, np.stack(ends, axis=2))
