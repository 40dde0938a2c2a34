"""Backward warping: a view's colours sampled from the source images that show its surfaces.

OpenCV samples one image at a time, at 32nds of a pixel. The loop here costs the same for one image
and for ten, a third of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import cv2
import numba
import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.geometry.epipolar import inside
from geovp_classic.parallel import SAME_BITS
from geovp_classic.rendering.grey_images import is_grey
from geovp_classic.rendering.patches import Source, projections, source_pixels
from geovp_classic.rendering.rasterizer import NEAR_SHARE, NO_INDEX, IndexArray
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics

MARGIN_PX = (
    4  # around each image, of its border's colours: as far as Lanczos' kernel of 8 x 8 reaches
)
PHASES = 256  # places between two pixels that the kernel is tabulated for
NOT_FINER = (
    0.95  # of the views' pixels that sources have; with fewer the sources are finer than the views
)
_FIRST = np.float32(
    MARGIN_PX - 3.5
)  # from an image's border to the middle of the kernel's first pixel there
_ZERO, _HALF, _WHITE, _PHASES = np.float32(0), np.float32(0.5), np.float32(255), np.float32(PHASES)
_TWO, _THREE, _FOUR = (
    np.uint64(2),
    np.uint64(3),
    np.uint64(4),
)  # unsigned, so that negative indices need no check


def lanczos_weights() -> FloatArray:
    """Lanczos' kernel (Duchon 1979) of 8 pixels at [PHASES + 1] places between the fourth and the
    fifth; float32.
    """
    offset = np.arange(-3, 5) - np.linspace(0, 1, PHASES + 1)[:, None]
    weights = np.sinc(offset) * np.sinc(offset / 4)
    return (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)


WEIGHTS = lanczos_weights()


@dataclass(frozen=True)
class ImageStack:
    """Images of one size with margins, sampled by Lanczos' kernel."""

    channels: (
        FloatArray  # [S, 1, H', W'] float32 when all are grey, else [S, 3, H', W']; with margins
    )

    @classmethod
    def of(cls, frames: Sequence[ByteArray]) -> Self:
        """The images of frames [H, W, 3]."""
        stacked = np.stack(frames)
        if is_grey(stacked):
            stacked = stacked[..., :1]  # a third of the work
        margins = [(0, 0), (MARGIN_PX, MARGIN_PX), (MARGIN_PX, MARGIN_PX), (0, 0)]
        framed = np.pad(stacked, margins, mode="edge").astype(np.float32)
        return cls(np.ascontiguousarray(np.moveaxis(framed, -1, 1)))

    def sample(
        self,
        pixels: FloatArray,  # [H, W, 2] float32 of an image, from -0.5 to its size - 0.5
        source_index: IndexArray,  # [H, W], of which image; NOTHING is black
        scale: tuple[float, float],  # how many pixels an image has to each that is meant
    ) -> ByteArray:
        """Colours [H, W, 3] by Lanczos' kernel of 8 x 8, its place rounded to a 256th of a
        pixel.
        """
        planes = np.zeros((self.channels.shape[1], *source_index.shape), np.uint8)
        columns = np.empty(WEIGHTS.shape[1], np.float32)
        for channel, plane in enumerate(planes):
            _sample(
                self.channels,
                channel,
                pixels,
                source_index,
                np.array(scale, np.float32),
                WEIGHTS,
                columns,
                plane,
            )
        return np.asarray(
            cv2.merge([planes[0]] * 3 if len(planes) == 1 else list(planes)), np.uint8
        )


@dataclass(frozen=True)
class ImageSampler:
    """Samples sources that were taken with one camera for the views of another."""

    sources: Sequence[Source]
    camera: Intrinsics  # of the views
    coarse: ImageStack
    coarse_scale: tuple[float, float]  # its pixels per pixel of the sources' camera
    fine: ImageStack | None  # the images with more pixels, if there are such
    fine_scale: tuple[float, float]
    magnified: float  # magnification of a view over the coarse images, at equal depth
    finest: float  # the magnification up to which the fine images hold detail

    @classmethod
    def of(cls, sources: Sequence[Source], camera: Intrinsics) -> Self:
        """A sampler of at least one source; all of them have more detail, or none.

        Where the sources have more pixels than views of the camera, these are the detail of coarser
        images.
        """
        own, frames = sources[0].camera, [source.frame for source in sources]
        details = [source.detail for source in sources if source.detail is not None]
        ratio = camera.fx_px / own.fx_px
        if ratio < NOT_FINER:
            details = details or frames
            size_px = max(1, round(own.width_px * ratio)), max(1, round(own.height_px * ratio))
            frames = [pinhole.resize(frame, size_px) for frame in frames]
        coarse_scale, fine_scale = _scale(frames[0], own), _scale((details or frames)[0], own)
        return cls(
            sources,
            camera,
            ImageStack.of(frames),
            coarse_scale,
            ImageStack.of(details) if details else None,
            fine_scale,
            ratio / coarse_scale[0],
            fine_scale[0] / coarse_scale[0],
        )

    def sample(
        self,
        inverse_depth: FloatArray,  # [H, W] float32 in the view, 0 = infinitely far
        source_index: IndexArray,  # [H, W], of the source that shows it, or NOTHING
        world_from_cam: FloatArray,  # [4, 4]
    ) -> tuple[ByteArray, BoolArray, FloatArray]:
        """The view [H, W, 3], black where no source shows it; coverage [H, W]; and the
        magnification [H, W] float32.

        The magnification of surfaces that face the camera is the depth ratio source / view, over
        what the finer images make up for; NaN where nothing is covered.
        """
        first = self.sources[0]
        poses = np.stack([source.world_from_source for source in self.sources])
        view = Source(np.zeros((0, 0, 3), np.uint8), self.camera, world_from_cam)
        a, b = projections(view, poses, first.camera)
        pixels, ratio = (
            np.empty((*source_index.shape, 2), np.float32),
            np.empty(source_index.shape, np.float32),
        )
        last = first.camera.width_px - 0.5, first.camera.height_px - 0.5
        _project_to_sources(
            a.astype(np.float32),
            b.astype(np.float32),
            inverse_depth,
            source_index,
            last,
            pixels,
            ratio,
        )
        covered = np.isfinite(ratio)
        shown_by = np.where(covered, source_index, np.int32(NO_INDEX))
        ratio *= np.float32(self.magnified)
        frame = self.coarse.sample(pixels, shown_by, self.coarse_scale)
        if self.fine is not None:
            magnified = np.where(covered, ratio - 1, 0) / np.float32(max(self.finest - 1, 1e-6))
            share = np.clip(magnified, 0, 1).astype(np.float32)[..., None]
            fine = self.fine.sample(
                pixels, np.where(magnified > 0, shown_by, np.int32(NO_INDEX)), self.fine_scale
            )
            frame = (frame + share * (fine.astype(np.float32) - frame) + np.float32(0.5)).astype(
                np.uint8
            )
        return frame, covered, ratio / np.float32(self.finest)


def resampled(source: Source, camera: Intrinsics) -> ByteArray:
    """The source's image [H, W, 3] for another camera at its pose; the border's colours outside of
    the source.
    """
    if source.camera == camera:
        return source.frame
    sampler = ImageSampler.of([source], camera)
    last = np.array([source.camera.width_px - 1, source.camera.height_px - 1], np.float32)
    infinity = np.zeros((camera.height_px, camera.width_px), np.float32)
    pixels = np.clip(source_pixels(source, infinity, source.world_from_source, camera)[0], 0, last)
    return sampler.coarse.sample(pixels, np.zeros(pixels.shape[:2], np.int32), sampler.coarse_scale)


def warp(
    source: Source,
    inverse_depth: FloatArray,  # [H, W] in the view; 0 = infinitely far, NaN = nothing there
    world_from_cam: FloatArray,  # [4, 4]
    camera: Intrinsics,
) -> tuple[ByteArray, BoolArray, FloatArray, FloatArray]:
    """One source seen from a pose by backward warping, bicubic.

    Colours [H, W, 3], black where the source doesn't show the view's surface; where it does [H, W];
    the source's pixels [H, W, 2] and the depth ratio source / view [H, W].
    """
    pixels, ratio = source_pixels(source, inverse_depth, world_from_cam, camera)
    shown = (ratio > 0) & inside(pixels, source.camera, border_px=0.5)
    u, v = np.moveaxis(np.where(shown[..., None], pixels, np.float32(0)), -1, 0)
    frame = cv2.remap(source.frame, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.where(shown[..., None], frame, np.uint8(0)), shown, pixels, ratio


def _scale(frame: ByteArray, camera: Intrinsics) -> tuple[float, float]:
    """Pixels of the frame per pixel of the camera, along u and v."""
    return frame.shape[1] / camera.width_px, frame.shape[0] / camera.height_px


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _project_to_sources(
    a: FloatArray,  # [S, 3, 3] float32
    b: FloatArray,  # [S, 3] float32
    inverse_depth: FloatArray,  # [H, W] float32
    source_index: IndexArray,  # [H, W]
    last: tuple[float, float],  # u and v of the outermost border of the sources
    pixels: FloatArray,  # [H, W, 2] float32, written where the source has it
    ratio: FloatArray,  # [H, W] float32, written; NaN elsewhere
) -> None:
    """Where in its source each pixel of the view lies: A (u, v, 1) + q b."""
    height, width = inverse_depth.shape
    for row in range(height):
        for column in range(width):
            ratio[row, column] = np.nan
            n = source_index[row, column]
            if n == NO_INDEX:
                continue
            u, v, q = np.float32(column), np.float32(row), inverse_depth[row, column]
            z = a[n, 2, 0] * u + a[n, 2, 1] * v + a[n, 2, 2] + q * b[n, 2]
            if not z > np.float32(NEAR_SHARE):
                continue
            x = (a[n, 0, 0] * u + a[n, 0, 1] * v + a[n, 0, 2] + q * b[n, 0]) / z
            y = (a[n, 1, 0] * u + a[n, 1, 1] * v + a[n, 1, 2] + q * b[n, 1]) / z
            if x >= np.float32(-0.5) and y >= np.float32(-0.5) and x <= last[0] and y <= last[1]:
                pixels[row, column, 0], pixels[row, column, 1], ratio[row, column] = x, y, z


@numba.njit(nogil=True, cache=True, fastmath=SAME_BITS, error_model="numpy")
def _sample(
    channels: FloatArray,  # [S, C, H', W'] float32 with margins
    channel: int,
    pixels: FloatArray,  # [H, W, 2] float32
    source_index: IndexArray,  # [H, W]
    scale: FloatArray,  # [2] float32
    weights: FloatArray,  # [PHASES + 1, 8] float32
    columns: FloatArray,  # [8] float32, changed
    plane: ByteArray,  # [H, W], written where there is a source
) -> None:
    """The weighted sum of 8 x 8 values at every pixel.

    The compiler vectorises the innermost loop because it does not know its length; one of known
    length, or one more loop around, it would unroll. The sums of the eight columns are added up
    afterwards, always in the same order.
    """
    flat, taps = channels.reshape(-1), np.uint64(len(columns))
    count, rows, stride = (
        np.uint64(channels.shape[1]),
        np.uint64(channels.shape[2]),
        np.uint64(channels.shape[3]),
    )
    shift_u, shift_v = _HALF * scale[0] + _FIRST, _HALF * scale[1] + _FIRST
    for row in range(source_index.shape[0]):
        for column in range(source_index.shape[1]):
            n = source_index[row, column]
            if n == NO_INDEX:
                continue
            u, v = (
                pixels[row, column, 0] * scale[0] + shift_u,
                pixels[row, column, 1] * scale[1] + shift_v,
            )
            left, top = np.int32(u), np.int32(v)
            phase_u = np.uint64(np.int32((u - np.float32(left)) * _PHASES + _HALF))
            phase_v = np.uint64(np.int32((v - np.float32(top)) * _PHASES + _HALF))
            d0, d1, d2, d3 = (
                weights[phase_v, 0],
                weights[phase_v, 1],
                weights[phase_v, 2],
                weights[phase_v, 3],
            )
            d4, d5, d6, d7 = (
                weights[phase_v, 4],
                weights[phase_v, 5],
                weights[phase_v, 6],
                weights[phase_v, 7],
            )
            r0 = (
                (np.uint64(n) * count + np.uint64(channel)) * rows + np.uint64(top)
            ) * stride + np.uint64(left)
            r1, r2, r3, r4 = (
                r0 + stride,
                r0 + _TWO * stride,
                r0 + _THREE * stride,
                r0 + _FOUR * stride,
            )
            r5, r6, r7 = r4 + stride, r4 + _TWO * stride, r4 + _THREE * stride
            for i in range(taps):
                upper = (
                    d0 * flat[r0 + i] + d1 * flat[r1 + i] + d2 * flat[r2 + i] + d3 * flat[r3 + i]
                )
                lower = (
                    d4 * flat[r4 + i] + d5 * flat[r5 + i] + d6 * flat[r6 + i] + d7 * flat[r7 + i]
                )
                columns[i] = weights[phase_u, i] * (upper + lower)
            left_half = (columns[0] + columns[1]) + (columns[2] + columns[3])
            value = left_half + ((columns[4] + columns[5]) + (columns[6] + columns[7])) + _HALF
            plane[row, column] = np.uint8(min(max(value, _ZERO), _WHITE))
