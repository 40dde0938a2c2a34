"""Read a view's colours backward from the pictures that show its surfaces, each pixel once and from one picture.

The pictures lie side by side in one large one, so that a view costs the same whether one picture shows it all or ten do
in turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numba
import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.render.quads import NEAR_SHARE, NOTHING, IndexArray
from geovp_classic.render.surface import Source, own_pixels, plane_sweep_maps
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics

MARGIN_PX = 4  # around each picture, of its border's colours: as far as Lanczos' kernel of 8 x 8 reaches
NOT_FINER = 0.95  # of the views' pixels that sources have; with fewer the sources are finer than the views
ELSEWHERE = -1e6  # outside of every sheet, where all is black


def is_grey(frames: ByteArray) -> bool:
    """Whether all channels of frames [..., 3] are the same."""
    first = frames[..., 0]
    return bool(np.array_equal(first, frames[..., 1]) and np.array_equal(first, frames[..., 2]))


@dataclass(frozen=True)
class Sheet:
    """Pictures of one size beside and below each other."""

    picture: ByteArray  # [H', W'] when all are grey, else [H', W', 3]
    corners: FloatArray  # [S, 2] float32, where the first pixel (u, v) of each lies

    @classmethod
    def of(cls, frames: Sequence[ByteArray]) -> Sheet:
        """The sheet of frames [H, W, 3]."""
        stacked = np.stack(frames)
        if is_grey(stacked):
            stacked = stacked[..., 0]  # takes a third of the time
        height, width = stacked.shape[1] + 2 * MARGIN_PX, stacked.shape[2] + 2 * MARGIN_PX
        across = int(np.ceil(np.sqrt(len(stacked))))  # OpenCV reads pictures of less than 32,768 rows and columns
        down = int(np.ceil(len(stacked) / across))
        picture = np.zeros((down * height, across * width, *stacked.shape[3:]), np.uint8)
        places = np.stack(np.divmod(np.arange(len(stacked)), across), axis=-1) * [height, width]
        for frame, (row, column) in zip(stacked, places, strict=True):
            framed = cv2.copyMakeBorder(frame, MARGIN_PX, MARGIN_PX, MARGIN_PX, MARGIN_PX, cv2.BORDER_REPLICATE)
            picture[row : row + height, column : column + width] = framed
        return cls(picture, (places[:, ::-1] + MARGIN_PX).astype(np.float32))

    def read(
        self,
        pixels: FloatArray,  # [H, W, 2] float32 of the first picture, from -0.5 to its size - 0.5
        number: IndexArray,  # [H, W], of which picture instead; NOTHING is black
        scale: tuple[float, float],  # how many pixels a picture has to each that is meant
    ) -> ByteArray:
        """Colours [H, W, 3] by Lanczos' kernel."""
        places = np.empty((2, *number.shape), np.float32)
        _place(pixels, number, scale, self.corners, places)
        read = cv2.remap(self.picture, places[0], places[1], cv2.INTER_LANCZOS4)
        return np.asarray(read if self.picture.ndim == 3 else cv2.cvtColor(read, cv2.COLOR_GRAY2RGB))


@dataclass(frozen=True)
class Reader:
    """The pictures of sources that were taken with one camera, for the views of another."""

    sources: Sequence[Source]
    camera: Intrinsics  # of the views
    coarse: Sheet
    coarse_scale: tuple[float, float]  # its pixels per pixel of the sources' camera
    fine: Sheet | None  # the pictures with more pixels, if there are such
    fine_scale: tuple[float, float]
    magnified: float  # by what a surface as near as in its source is larger in a view than in the coarse pictures
    finest: float  # the magnification up to which the fine pictures hold detail

    @classmethod
    def of(cls, sources: Sequence[Source], camera: Intrinsics) -> Reader:
        """A reader of at least one source; all of them have more detail, or none.

        Where the sources have more pixels than views of the camera, these are the detail of coarser pictures.
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
            Sheet.of(frames),
            coarse_scale,
            Sheet.of(details) if details else None,
            fine_scale,
            ratio / coarse_scale[0],
            fine_scale[0] / coarse_scale[0],
        )

    def observed(self) -> ByteArray:
        """What the camera would have seen [H, W, 3] in the place of the first source; the border's colours outside."""
        pixels = own_pixels(self.sources[0], self.camera)
        last = np.array([self.sources[0].camera.width_px - 1, self.sources[0].camera.height_px - 1], np.float32)
        first = np.zeros(pixels.shape[:2], np.int32)
        return self.coarse.read(np.clip(pixels, 0, last), first, self.coarse_scale)

    def read(
        self,
        inverse_depth: FloatArray,  # [H, W] float32 in the view, 0 = infinitely far
        number: IndexArray,  # [H, W], of the source that shows it, or NOTHING
        world_from_cam: FloatArray,  # [4, 4]
    ) -> tuple[ByteArray, BoolArray, FloatArray]:
        """The view [H, W, 3], black where no source shows it; coverage [H, W]; and the magnification [H, W] float32.

        The magnification is by what surfaces that face the camera are larger than in the pictures (the depth ratio
        source / view), over what the finer pictures make up for; not a number where nothing is covered.
        """
        first = self.sources[0]
        poses = np.stack([source.world_from_source for source in self.sources])
        view = Source(np.zeros((0, 0, 3), np.uint8), self.camera, world_from_cam)
        a, b = plane_sweep_maps(view, poses, first.camera)
        pixels, ratio = np.empty((*number.shape, 2), np.float32), np.empty(number.shape, np.float32)
        last = first.camera.width_px - 0.5, first.camera.height_px - 0.5
        _follow(a.astype(np.float32), b.astype(np.float32), inverse_depth, number, last, pixels, ratio)
        covered = np.isfinite(ratio)
        shown = np.where(covered, number, np.int32(NOTHING))
        ratio *= np.float32(self.magnified)
        frame = self.coarse.read(pixels, shown, self.coarse_scale)
        if self.fine is not None:
            fine = self.fine.read(pixels, shown, self.fine_scale)
            share = np.clip((ratio - 1) / max(self.finest - 1, 1e-6), 0, 1).astype(np.float32)[..., None]
            mixed = frame + np.where(covered[..., None], share, 0) * (fine.astype(np.float32) - frame)
            frame = (mixed + 0.5).astype(np.uint8)
        return frame, covered, ratio / np.float32(self.finest)


def _scale(frame: ByteArray, camera: Intrinsics) -> tuple[float, float]:
    """Pixels of the frame per pixel of the camera, along u and v."""
    return frame.shape[1] / camera.width_px, frame.shape[0] / camera.height_px


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _follow(
    a: FloatArray,  # [S, 3, 3] float32
    b: FloatArray,  # [S, 3] float32
    inverse_depth: FloatArray,  # [H, W] float32
    number: IndexArray,  # [H, W]
    last: tuple[float, float],  # u and v of the outermost border of the sources
    pixels: FloatArray,  # [H, W, 2] float32, written where the source has it
    ratio: FloatArray,  # [H, W] float32, written; NaN elsewhere
) -> None:
    """Where in its source each pixel of the view lies: A (u, v, 1) + q b."""
    height, width = inverse_depth.shape
    for row in range(height):
        for column in range(width):
            ratio[row, column] = np.nan
            n = number[row, column]
            if n == NOTHING:
                continue
            u, v, q = np.float32(column), np.float32(row), inverse_depth[row, column]
            z = a[n, 2, 0] * u + a[n, 2, 1] * v + a[n, 2, 2] + q * b[n, 2]
            if not z > np.float32(NEAR_SHARE):
                continue
            x = (a[n, 0, 0] * u + a[n, 0, 1] * v + a[n, 0, 2] + q * b[n, 0]) / z
            y = (a[n, 1, 0] * u + a[n, 1, 1] * v + a[n, 1, 2] + q * b[n, 1]) / z
            if x >= np.float32(-0.5) and y >= np.float32(-0.5) and x <= last[0] and y <= last[1]:
                pixels[row, column, 0], pixels[row, column, 1], ratio[row, column] = x, y, z


@numba.njit(nogil=True, cache=True)
def _place(
    pixels: FloatArray,  # [H, W, 2] float32
    number: IndexArray,  # [H, W]
    scale: tuple[float, float],
    corners: FloatArray,  # [S, 2] float32
    places: FloatArray,  # [2, H, W] float32, written: where on the sheet
) -> None:
    height, width = number.shape
    for row in range(height):
        for column in range(width):
            n = number[row, column]
            for axis in range(2):
                place = ELSEWHERE
                if n != NOTHING:
                    place = corners[n, axis] + (pixels[row, column, axis] + 0.5) * scale[axis] - 0.5
                places[axis, row, column] = place
