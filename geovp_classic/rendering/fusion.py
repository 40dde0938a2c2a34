"""Fusion of the observed frames into one cloud of surface patches, which is rendered from each
future pose.

The last frame shows what lies ahead at the best resolution, so all its pixels are kept; an earlier
frame adds only surfaces that no later one sees: occluded there, or outside its image. Depths of one
surface from two frames must agree, or the earlier one is dropped. Colours are sampled once,
backward, from the frame of each patch, and stay sharp.
"""

from dataclasses import dataclass

import cv2
import numba
import numpy as np

from geovp_classic.interfaces import Inpainter
from geovp_classic.parallel import parallel_map
from geovp_classic.rendering import patches
from geovp_classic.rendering.detail_transfer import FrameDetail
from geovp_classic.rendering.grey_images import is_grey
from geovp_classic.rendering.image_sampler import ImageSampler, resampled
from geovp_classic.rendering.rasterizer import NO_INDEX, IndexArray
from geovp_classic.types import BoolArray, ByteArray, FloatArray, IntArray, Intrinsics, Views

LARGEST_MAGNIFICATION = 6.0
_AROUND = np.ones((3, 3), np.uint8)


def fuse(
    sources: list[patches.Source],
    inverse_depths: FloatArray,  # [P, H, W]
    confidence: FloatArray,  # [P, H, W]
    agreement: float,
) -> tuple[patches.Patches, list[patches.Source]]:
    """The last frame's patches, those of earlier frames that no later one sees; and the used
    sources, latest first.
    """
    used: list[patches.Source] = []
    maps: list[FloatArray] = []
    clouds: list[patches.Patches] = []
    for source, inverse_depth, certainty in reversed(
        list(zip(sources, inverse_depths, confidence, strict=True))
    ):
        known = certainty > 0 if used else np.ones(certainty.shape, dtype=bool)
        for later, later_depth in zip(used, maps, strict=True):
            if known.any():
                known &= _hidden_from(later, later_depth, source, inverse_depth, agreement)
        if known.any():
            clouds.append(patches.from_depth_map(inverse_depth, known, len(used)))
            used.append(source)
            maps.append(inverse_depth)
    return patches.concatenate(clouds), used


def remove_masked(
    cloud: patches.Patches,
    source: int,
    mask: BoolArray,  # [H, W] of that source
) -> patches.Patches:
    """The cloud without that source's patches in the mask."""
    if not mask.any():
        return cloud
    column, row = np.round(cloud.pixels).astype(int).T
    own = cloud.source == source
    kept = ~own
    kept[own] = ~mask[row[own], column[own]]
    return patches.Patches(
        *(getattr(cloud, name)[kept] for name in patches.Patches.__dataclass_fields__)
    )


def _hidden_from(
    later: patches.Source,
    later_depth: FloatArray,
    source: patches.Source,
    inverse_depth: FloatArray,
    agreement: float,
) -> BoolArray:
    """Which of the source's pixels [H, W] the later frame does not show: beside its image or behind
    its surfaces.

    A surface in front of the later frame's surfaces would be visible there: its depth is wrong, so
    it is not hidden.
    """
    pixels, ratio = patches.source_pixels(
        later, inverse_depth, source.world_from_source, source.camera
    )
    hidden = np.empty(ratio.shape, np.bool_)
    _mark_hidden(
        pixels, ratio, np.asarray(inverse_depth, np.float32), later_depth, 1 - agreement, hidden
    )
    return hidden


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _mark_hidden(
    pixels: FloatArray,  # [H, W, 2] of the later frame
    ratio: FloatArray,  # [H, W], depth in the later frame over own depth
    inverse_depth: FloatArray,  # [H, W]
    later_depth: FloatArray,  # [H', W'], inverse
    share: float,
    hidden: BoolArray,  # [H, W], written: True beside the later image or behind its surfaces
) -> None:
    for row in range(ratio.shape[0]):
        for column in range(ratio.shape[1]):
            u, v = np.rint(pixels[row, column, 0]), np.rint(pixels[row, column, 1])
            within = u >= 0 and v >= 0 and u < later_depth.shape[1] and v < later_depth.shape[0]
            hidden[row, column] = True
            if ratio[row, column] > 0 and within:
                own = inverse_depth[row, column] / ratio[row, column]
                hidden[row, column] = own < later_depth[int(v), int(u)] * share


@dataclass(frozen=True)
class CloudScene:
    """A fused cloud with the images its colours are read from."""

    cloud: patches.Patches
    sources: list[patches.Source]  # the last observed frame first
    inpainter: Inpainter
    crack_px: int
    detail_strength: float

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        """The cloud from the poses [F, 4, 4]; uncovered where no observed frame shows the
        surface.
        """
        z_buffer, winner = patches.rasterise(self.cloud, self.sources, world_from_cam, intrinsics)
        frames, covered = (
            np.empty((*z_buffer.shape, 3), np.uint8),
            np.empty(z_buffer.shape, dtype=bool),
        )
        depths, magnification = (
            z_buffer,
            np.empty(z_buffer.shape, np.float32),
        )  # new memory takes as long as filling it
        sampler = ImageSampler.of(self.sources, intrinsics)
        source_of = np.append(
            self.cloud.source, np.int32(NO_INDEX)
        )  # NO_INDEX, -1, is the last one

        def render_view(step: int) -> None:
            inverse_depth, source_index = _close_cracks(
                z_buffer[step], source_of[winner[step]], self.crack_px
            )
            inverse_depth = _median_filter(inverse_depth, source_index)
            frames[step], covered[step], magnified = sampler.sample(
                inverse_depth, source_index, world_from_cam[step]
            )
            magnification[step] = np.where(
                covered[step], magnified, np.float32(LARGEST_MAGNIFICATION)
            )
            with np.errstate(divide="ignore"):
                depths[step] = np.where(covered[step], np.float32(1) / inverse_depth, np.float32(0))

        parallel_map(render_view, range(len(world_from_cam)))
        last = resampled(self.sources[0], intrinsics)
        filled = self.inpainter.inpaint(Views(frames, covered, depths), last)
        return Views(self._with_detail(filled, magnification, last), covered, depths)

    def _with_detail(
        self, frames: ByteArray, magnification: FloatArray, observed: ByteArray
    ) -> ByteArray:
        if self.detail_strength == 0:
            return frames
        channels = slice(0, 1 if is_grey(observed) and is_grey(frames) else 3)
        detail, result = FrameDetail.of(observed[..., channels]), np.empty_like(frames)

        def add(step: int) -> None:
            sharper = detail.add_to(
                frames[step, ..., channels], magnification[step], self.detail_strength
            )
            result[step] = (
                sharper if sharper.shape[-1] == 3 else cv2.cvtColor(sharper, cv2.COLOR_GRAY2RGB)
            )

        parallel_map(add, range(len(result)))
        return result


def _close_cracks(
    inverse_depth: FloatArray,  # [H, W]
    source_index: IndexArray,  # [H, W], NO_INDEX in gaps
    crack_px: int,
) -> tuple[FloatArray, IndexArray]:
    """Gaps between surfaces that are at most 2 crack_px wide take the farther one of the surfaces
    beside them.
    """
    seen = (source_index != NO_INDEX).view(np.uint8)
    kernel = np.ones((2 * crack_px + 1, 2 * crack_px + 1), np.uint8)
    gaps = np.flatnonzero(cv2.morphologyEx(seen, cv2.MORPH_CLOSE, kernel) > seen)
    depth, filled = np.where(seen, inverse_depth, np.float32(np.inf)), source_index.copy()
    _grow_background(
        gaps, np.empty(len(gaps), np.float32), np.empty_like(gaps), depth, filled, 2 * crack_px
    )
    return np.where(filled == NO_INDEX, np.float32(-1), depth), filled


def _median_filter(
    inverse_depth: FloatArray,  # [H, W] float32
    source_index: IndexArray,  # [H, W]
) -> FloatArray:
    """A median filter against single patches that stick out of their surface; lines of two pixels
    stay.

    Overlapping patches of one surface differ slightly in depth, and each samples its own colour.
    Pixels with a neighbour of another source, or without one, stay as they are.
    """
    source_index = source_index.astype(np.int16)
    inside = cv2.erode(source_index, _AROUND) == cv2.dilate(source_index, _AROUND)
    for _ in range(2):
        inverse_depth = np.where(inside, cv2.medianBlur(inverse_depth, 3), inverse_depth)
    return inverse_depth


@numba.njit(nogil=True, cache=True)
def _grow_background(
    gaps: IntArray,  # [N] pixels to be closed, in reading order; changed
    found: FloatArray,  # [N] float32, changed
    whose: IntArray,  # [N], changed
    depth: FloatArray,  # [H, W] float32, changed; infinite where unknown
    source_index: IndexArray,  # [H, W], changed
    rounds: int,
) -> None:
    """In each round the gaps' pixels take the farthest of their four neighbours, where one is
    known.
    """
    (height, width), count = depth.shape, len(gaps)
    for _ in range(rounds):
        for n in range(count):
            row, column = gaps[n] // width, gaps[n] % width
            found[n], whose[n] = np.inf, NO_INDEX
            for side in range(4):
                y, x = row + (side == 1) - (side == 0), column + (side == 3) - (side == 2)
                if 0 <= y < height and 0 <= x < width and depth[y, x] < found[n]:
                    found[n], whose[n] = depth[y, x], source_index[y, x]
        num_left = 0
        for n in range(count):
            if whose[n] == NO_INDEX:
                gaps[num_left] = gaps[n]
                num_left += 1
            else:
                depth[gaps[n] // width, gaps[n] % width] = found[n]
                source_index[gaps[n] // width, gaps[n] % width] = whose[n]
        count = num_left
