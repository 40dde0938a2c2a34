"""Colours of a view, sampled from the source images that show its surfaces."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geovp_classic.rendering.rasterizer import IndexArray
from geovp_classic.rendering.source import Source, to_bytes
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics


@dataclass(frozen=True)
class ImageSampler:
    """Source images at two resolutions, between which magnification decides (Williams 1983)."""

    fine: Sequence[Source]  # at least one
    camera: Intrinsics  # of the views

    @functools.cached_property
    def coarse(self) -> list[Source]:
        """Return the sources with images that are no finer than the views."""
        return [source.shrunk(self.camera) for source in self.fine]

    def sample(
        self,
        inverse_depth: FloatArray,  # [H, W] float32 in the view, 0 = infinitely far
        source_index: IndexArray,  # [H, W], of the source that shows it, or NO_INDEX
        world_from_cam: FloatArray,  # [4, 4]
    ) -> tuple[ByteArray, BoolArray, FloatArray]:
        """Return the view [H, W, 3], its coverage [H, W] and its magnification [H, W] float32.

        Pixels that no source shows are black, and their magnification is infinite.
        """
        layers = []  # colours from each source, 0 where it is not shown
        magnification = np.full(source_index.shape, np.inf, np.float32)
        for index, (fine, coarse) in enumerate(zip(self.fine, self.coarse, strict=True)):
            # Where the source shows the view's surface, and how much larger the view does.
            pixels, ratio = fine.project(inverse_depth, world_from_cam, self.camera)
            is_shown = (source_index == index) & fine.is_visible(pixels, ratio)
            magnified = ratio * (self.camera.fx_px / (fine.camera.fx_px * fine.resolution))
            layers.append(_blend(fine, coarse, pixels, is_shown, magnified))
            magnification = np.where(is_shown, magnified, magnification)
        colours = functools.reduce(np.add, layers)
        return to_bytes(colours), np.isfinite(magnification), magnification


def _blend(
    fine: Source,
    coarse: Source,
    pixels: FloatArray,  # [H, W, 2]
    is_shown: BoolArray,  # [H, W]
    magnified: FloatArray,  # [H, W], pixels of the view per pixel of the fine image
) -> FloatArray:
    """Blend colours [H, W, C] float32 of both images, linearly in the magnification."""
    if fine is coarse:
        return fine.sample(pixels, is_shown)
    # Trilinear mipmapping between two levels, of which only those are sampled that count.
    coarsest = coarse.resolution / fine.resolution
    fraction = np.clip((magnified - coarsest) / (1 - coarsest), 0, 1)
    far = coarse.sample(pixels, is_shown & (fraction < 1))
    is_near = is_shown & (fraction > 0)
    if not is_near.any():
        return far
    near = fine.sample(pixels, is_near)
    return far + fraction[..., None] * (near - far)
