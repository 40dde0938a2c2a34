"""Posed images, and backward warping: views whose colours are sampled from an image."""

import functools
from dataclasses import dataclass, replace

import cv2
import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics

# Images are enlarged once by Lanczos' kernel, and sampled bicubically. This takes a quarter of the
# time of sampling with `INTER_LANCZOS4`. An odd factor keeps the pixels themselves. The enlarged
# image has 8 bits per value: 32 would take four times the memory for .005 dB.
ENLARGEMENT = 3
MARGIN_PX = 4  # half the size of OpenCV's Lanczos kernel
FRAME_PX = 2 * MARGIN_PX * ENLARGEMENT  # both margins of the enlarged image


@dataclass(frozen=True)
class Source:
    """A posed image, whose resolution may exceed that of the depth map of its camera."""

    frame: ByteArray  # [H', W', 3]
    camera: Intrinsics  # of the depth map; also of all pixels named below
    world_from_source: FloatArray  # [4, 4]

    @property
    def resolution(self) -> float:
        """Return the pixels of the image per pixel of the camera."""
        return self.frame.shape[1] / self.camera.width_px

    def project(
        self,
        inverse_depth: FloatArray,  # [H, W] in the view, 0 = infinitely far
        world_from_cam: FloatArray,  # [4, 4]
        camera: Intrinsics,
    ) -> tuple[FloatArray, FloatArray]:
        """Project a view's surface into this source.

        Return its pixels [H, W, 2] float32 and the depth ratio source / view [H, W]: the
        magnification of surfaces that face the camera. It is not positive behind the source.
        """
        source_from_cam = se3.inverse(self.world_from_source) @ world_from_cam
        return Epipolar.of(camera, source_from_cam, self.camera).project(inverse_depth)

    def is_visible(
        self, pixels: FloatArray, ratio: FloatArray, min_ratio: float = 1e-3
    ) -> BoolArray:
        """Return which projected points [H, W] lie in front of the source and in its image."""
        corner = self.camera.width_px - 0.5, self.camera.height_px - 0.5
        is_inside = cv2.inRange(pixels, (-0.5, -0.5), corner)
        return (ratio > min_ratio) & (is_inside > 0)

    def sample(
        self,
        pixels: FloatArray,  # [H, W, 2] float32, inside the image where it is sampled
        is_sampled: BoolArray,  # [H, W]
    ) -> FloatArray:
        """Sample colours [H, W, C] float32; 0 where they are not sampled.

        C is 1 for a grey image, else 3.
        """
        # Pixels of the camera to those of the enlarged image with its margins.
        height, width = self._enlarged.shape[:2]
        scale_u = (width - FRAME_PX) / self.camera.width_px
        scale_v = (height - FRAME_PX) / self.camera.height_px
        u, v = cv2.split(pixels)
        u = u * scale_u + (scale_u + FRAME_PX - 1) / 2
        v = v * scale_v + (scale_v + FRAME_PX - 1) / 2
        # Pixels that are not sampled are sought outside of the image, which costs no time.
        colours = cv2.remap(
            self._enlarged,
            np.where(is_sampled, u, np.float32(-1e4)),
            v,
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_CONSTANT,
        )
        return np.asarray(colours, np.float32).reshape(*is_sampled.shape, -1)

    @functools.cached_property
    def _enlarged(self) -> ByteArray:
        """Return the enlarged image with margins that continue its border.

        One channel holds a grey image.
        """
        is_grey = (self.frame == self.frame[..., :1]).all()
        framed = cv2.copyMakeBorder(
            self.frame[..., :1] if is_grey else self.frame,
            *(MARGIN_PX,) * 4,
            cv2.BORDER_REPLICATE,
        )
        return cv2.resize(
            framed,
            None,
            fx=ENLARGEMENT,
            fy=ENLARGEMENT,
            interpolation=cv2.INTER_LANCZOS4,
        )

    def shrunk(self, camera: Intrinsics, max_scale: float = 0.95) -> "Source":
        """Return the source with an image no finer than views of the camera.

        An image that is finer by less than `max_scale` says is kept.
        """
        scale = camera.fx_px / (self.camera.fx_px * self.resolution)
        if scale >= max_scale:
            return self
        height, width = self.frame.shape[:2]
        width_px = max(1, round(width * scale))
        height_px = max(1, round(height * scale))
        frame = pinhole.resize(self.frame, (width_px, height_px))
        return replace(self, frame=frame)


def warp(
    source: Source,
    inverse_depth: FloatArray,  # [H, W] in the view; 0 = infinitely far, NaN = nothing there
    world_from_cam: FloatArray,  # [4, 4]
    camera: Intrinsics,
) -> tuple[ByteArray, BoolArray, FloatArray, FloatArray]:
    """Render one source from a pose by backward warping.

    Return colours [H, W, 3], black where the source does not show the view's surface; where it
    does [H, W]; the source's pixels [H, W, 2] and the depth ratio source / view [H, W].
    """
    pixels, ratio = source.project(inverse_depth, world_from_cam, camera)
    is_shown = source.is_visible(pixels, ratio)
    return to_bytes(source.sample(pixels, is_shown)), is_shown, pixels, ratio


def to_bytes(colours: FloatArray) -> ByteArray:
    """Return colours [H, W, C] rounded to 8 bits, in three channels."""
    rounded = cv2.addWeighted(colours, 1, colours, 0, 0, dtype=cv2.CV_8U)
    if colours.shape[-1] == 1:
        rounded = cv2.cvtColor(rounded, cv2.COLOR_GRAY2RGB)
    return rounded


def resampled(source: Source, camera: Intrinsics) -> ByteArray:
    """Return the image [H, W, 3] that another camera takes at the source's pose.

    Outside of the source its border continues.
    """
    if camera == source.camera and source.resolution == 1:
        return source.frame
    infinity = np.zeros((camera.height_px, camera.width_px), np.float32)
    pixels, _ = source.project(infinity, source.world_from_source, camera)
    size_px = np.array(source.camera.size_px, np.float32)
    inside_pixels = np.clip(pixels, 0, size_px - 1)
    everywhere = np.ones(infinity.shape, bool)
    colours = source.shrunk(camera).sample(inside_pixels, everywhere)
    return to_bytes(colours)
