"""Fusion of the observed frames into one cloud of surface patches, which is rendered from each
future pose.

The last frame shows what lies ahead at the best resolution, so all its pixels are used; an earlier
frame adds only surfaces that no later one sees: occluded there, or outside its image. Colours are
sampled once, backward, from the frame of each patch, and stay sharp.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.interfaces import Inpainter
from geovp_classic.parallel import parallel_map
from geovp_classic.rendering import patches
from geovp_classic.rendering.image_sampler import ImageSampler
from geovp_classic.rendering.inpainting import inpainted_views
from geovp_classic.rendering.magnified_detail import MagnifiedDetail
from geovp_classic.rendering.patches import Patches, PatchModel
from geovp_classic.rendering.rasterizer import NO_INDEX, IndexArray
from geovp_classic.rendering.source import Source, resampled
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics, Views


def fuse(
    sources: Sequence[Source],  # P
    inverse_depths: FloatArray,  # [P, H, W]
    is_known: BoolArray,  # [P, H, W], pixels that may become patches
    max_depth_difference: float,  # relative, of one surface in two frames
    model: PatchModel,
) -> tuple[Patches, list[int]]:
    """Return the patches that no later frame shows, and the indices of their frames.

    The last frame comes first.
    """
    inverse_depths = np.asarray(inverse_depths, np.float32)
    used: list[int] = []
    clouds: list[Patches] = []
    for step in reversed(range(len(sources))):
        # Only surfaces that are hidden from all later frames are added: these show the others, from
        # nearer.
        is_new = is_known[step].copy()
        for later in used:
            if is_new.any():
                is_new &= hidden_from(
                    sources[later],
                    inverse_depths[later],
                    sources[step],
                    inverse_depths[step],
                    max_depth_difference,
                )
        # The last frame is used even without a known pixel, as a scene needs a source.
        if is_new.any() or not used:
            clouds.append(model.from_depth_map(inverse_depths[step], is_new, len(used)))
            used.append(step)
    return patches.concatenate(clouds), used


def hidden_from(
    later: Source,
    later_inverse_depth: FloatArray,  # [H, W] float32
    source: Source,
    inverse_depth: FloatArray,  # [H, W] float32
    max_depth_difference: float,
) -> BoolArray:
    """Return which pixels [H, W] of a source a later frame does not show.

    They lie outside its image or behind its surfaces. A surface in front of those would be visible
    in the later frame: its depth is wrong, so it does not count as hidden.
    """
    pixels, ratio = later.project(inverse_depth, source.world_from_source, source.camera)
    u, v = cv2.split(pixels)
    # The inverse depth of what the later frame shows there. Outside its image it is huge: all
    # surfaces are behind the border.
    shown_inverse_depth = cv2.remap(
        later_inverse_depth,
        u,
        v,
        cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=1e30,
    )
    # Depths along the source's rays are those along the later frame's rays over the ratio.
    is_behind = inverse_depth < ratio * shown_inverse_depth * (1 - max_depth_difference)
    is_behind_camera = ratio <= 0
    return np.asarray(is_behind_camera | is_behind)


@dataclass(frozen=True)
class CloudScene:
    """A fused cloud with the images that its colours are sampled from."""

    cloud: Patches
    sources: Sequence[Source]  # the last observed frame first
    model: PatchModel
    inpainter: Inpainter
    detail: MagnifiedDetail | None
    crack_px: int
    min_covered_fraction: float

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Return the views from the poses [F, 4, 4]; uncovered where no source shows a surface."""
        # Visibility: the nearest patch at each pixel of each view.
        z_buffer, winner = self.model.rasterise(
            self.cloud, self.sources, world_from_cam, intrinsics
        )
        sampler = ImageSampler(self.sources, intrinsics)
        # The last entry stands for pixels without a patch, whose number NO_INDEX is -1.
        source_of_patch = np.append(self.cloud.source, np.int32(NO_INDEX))

        def render(
            step: int,
        ) -> tuple[ByteArray, BoolArray, FloatArray, FloatArray]:
            # Surfaces without cracks and dots.
            winning_source = source_of_patch[winner[step]]
            closed_inverse_depth, source_index = close_cracks(
                z_buffer[step], winning_source, self.crack_px
            )
            inverse_depth = smooth(closed_inverse_depth, source_index)
            # Backward warping: each pixel is sampled once, from the frame of its patch.
            frame, covered, magnification = sampler.sample(
                inverse_depth, source_index, world_from_cam[step]
            )
            # A view that hardly any surface covers becomes the last frame as it is: less would be
            # continued over all of the image.
            if covered.mean() < self.min_covered_fraction:
                covered = np.zeros_like(covered)
                magnification = np.ones_like(magnification)
            return (
                frame,
                covered,
                patches.depths(inverse_depth, covered),
                magnification,
            )

        rendered = parallel_map(render, range(len(world_from_cam)))
        # What no frame shows is inpainted, and what is magnified takes detail of the last frame.
        last = resampled(self.sources[0], intrinsics)
        views = inpainted_views([view[:3] for view in rendered], self.inpainter, last)
        if self.detail is None:
            return views
        magnification = [view[3] for view in rendered]
        frames = self.detail.transfer(views.frames, magnification, last)
        return Views(frames, views.covered, views.depths)


def close_cracks(
    inverse_depth: FloatArray,  # [H, W] float32
    source_index: IndexArray,  # [H, W], NO_INDEX in gaps
    crack_px: int,
) -> tuple[FloatArray, IndexArray]:
    """Close gaps of at most 2 crack_px between surfaces.

    In each round the pixels of gaps take the farthest of their four neighbours.
    """
    # A morphological closing fills narrow gaps and leaves wide holes.
    is_seen = (source_index != NO_INDEX).view(np.uint8)
    kernel = np.ones((2 * crack_px + 1, 2 * crack_px + 1), np.uint8)
    is_gap = cv2.morphologyEx(is_seen, cv2.MORPH_CLOSE, kernel) - is_seen
    # A border of one pixel gives all pixels four neighbours. Pixels without a surface count as
    # infinitely near, so that they are copied only if all neighbours are such.
    border = (1, 1, 1, 1, cv2.BORDER_CONSTANT)
    closed_index = cv2.copyMakeBorder(source_index, *border, value=NO_INDEX)
    closed_inverse_depth = cv2.copyMakeBorder(inverse_depth, *border)
    closed_inverse_depth[closed_index == NO_INDEX] = np.inf
    gaps = np.flatnonzero(cv2.copyMakeBorder(is_gap, *border).view(bool))
    flat_index = closed_index.ravel()  # views, through which the images are written
    flat_inverse_depth = closed_inverse_depth.ravel()
    width = closed_index.shape[1]
    for _ in range(2 * crack_px):
        # All gaps choose their farthest neighbour before any of them is written.
        source = gaps - width
        for neighbour in (gaps + width, gaps - 1, gaps + 1):
            is_farther = flat_inverse_depth[neighbour] < flat_inverse_depth[source]
            source = np.where(is_farther, neighbour, source)
        flat_inverse_depth[gaps] = flat_inverse_depth[source]
        flat_index[gaps] = flat_index[source]
        gaps = gaps[flat_index[gaps] == NO_INDEX]  # those beside no surface yet
    closed_inverse_depth[closed_index == NO_INDEX] = -1
    return closed_inverse_depth[1:-1, 1:-1], closed_index[1:-1, 1:-1]


def smooth(
    inverse_depth: FloatArray,  # [H, W] float32
    source_index: IndexArray,  # [H, W]
) -> FloatArray:
    """Apply a median filter against single patches that stick out of their surface.

    Overlapping patches of one surface differ slightly in depth, and each samples its own colour.
    Lines of two pixels stay, and so do pixels with a neighbour of another source or without one.
    """
    # Inside one source, erosion and dilation of the index agree.
    index = source_index.astype(np.int16)
    kernel = np.ones((3, 3), np.uint8)
    is_inner = cv2.erode(index, kernel) == cv2.dilate(index, kernel)
    for _ in range(2):  # the second time removes pairs of dots, and keeps lines of two pixels
        inverse_depth = np.where(is_inner, cv2.medianBlur(inverse_depth, 3), inverse_depth)
    return inverse_depth
