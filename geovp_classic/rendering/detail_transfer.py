"""Transfer of fine detail to magnified surfaces, which one observed image cannot hold.

A surface that is seen z times larger than it was observed has no frequencies above 1 / z of the
finest one: roads, walls and trees blur, which perceptual metrics and people dislike more than wrong
texture. While a car drives on, the texture at one place of the image changes little (road below,
walls and trees beside). So the missing frequency bands are taken from the last observed frame at
the same pixels, at the local contrast of the view. Bands are cut as in a Laplacian pyramid (Burt &
Adelson 1983).
"""

import itertools
from dataclasses import dataclass
from typing import Self

import cv2
import numba
import numpy as np

from geovp_classic.parallel import SAME_BITS
from geovp_classic.types import ByteArray, FloatArray

BAND_EDGES = (1.0, 1.7, 2.7, 4.0, 6.0)  # magnifications between which each band is lost
BLUR_PX = 0.5  # standard deviation of the low-pass filter, per unit of magnification
COARSE_PX = 4.0  # detail is what a blur of this standard deviation removes
CONTRAST_PX = 6.0  # the neighbourhood in which contrasts are compared
FLOOR = 2.0  # grey levels of contrast below which nothing is amplified
LARGEST_GAIN = 1.0
FINEST_PX = (
    2.0  # the smallest standard deviation of a blur on a smaller image; less would show its pixels
)
_BAND_LOSS = (
    np.array([(1.0, fine) for fine in BAND_EDGES[:-1]], np.float32)
    / np.diff(BAND_EDGES).astype(np.float32)[:, None]
)
_NUM_BANDS, _LARGEST_GAIN = len(_BAND_LOSS), np.float32(LARGEST_GAIN)
_ZERO, _HALF, _ONE, _WHITE = np.float32(0), np.float32(0.5), np.float32(1), np.float32(255)


@dataclass(frozen=True)
class FrameDetail:
    """The frequency bands of an observed frame, finest first, and its local contrast, channel by
    channel.
    """

    bands: FloatArray  # [C, B, H, W] float32
    contrast: FloatArray  # [C, H, W] float32

    @classmethod
    def of(cls, frame: ByteArray) -> Self:
        """The detail of a frame [H, W, C], in colour or in grey."""
        images = _planes(frame)
        return cls(
            np.stack([_bands(one) for one in images]), np.stack([_contrast(one) for one in images])
        )

    def add_to(
        self,
        frame: ByteArray,  # [H, W, C]
        magnification: FloatArray,  # [H, W], 1 where nothing was lost
        strength: float = 1.0,
    ) -> ByteArray:
        """The frame with the bands that magnification removed, at the local contrast of
        the frame.
        """
        images, magnified = _planes(frame), magnification.astype(np.float32)
        added = np.empty(images.shape, np.uint8)
        for image, bands, contrast, result in zip(
            images, self.bands, self.contrast, added, strict=True
        ):
            _add(
                image, bands, magnified, np.float32(strength), (_contrast(image), contrast), result
            )
        return np.moveaxis(added, 0, -1)


def _planes(frame: ByteArray) -> FloatArray:
    """The channels of a frame [H, W, C] one by one [C, H, W], float32."""
    return np.ascontiguousarray(np.moveaxis(frame, -1, 0), dtype=np.float32)


@numba.njit(nogil=True, cache=True, fastmath=SAME_BITS, error_model="numpy")
def _add(
    image: FloatArray,  # [H, W] float32
    bands: FloatArray,  # [B, H, W] float32
    magnification: FloatArray,  # [H, W] float32
    strength: np.float32,
    contrasts: tuple[
        FloatArray, FloatArray
    ],  # [H, W] float32, of the image and of the frame with the bands
    added: ByteArray,  # [H, W], written
) -> None:
    """Add to every pixel the share of each band that its magnification removed."""
    height, width = image.shape
    own, other = contrasts
    for row in range(height):
        for column in range(width):
            magnified, missing = magnification[row, column], _ZERO
            for b in range(_NUM_BANDS):
                missing += (
                    min(max(_BAND_LOSS[b, 0] * magnified - _BAND_LOSS[b, 1], _ZERO), _ONE)
                    * bands[b, row, column]
                )
            gain = strength * min(own[row, column] / other[row, column], _LARGEST_GAIN)
            added[row, column] = np.uint8(
                min(max(image[row, column] + gain * missing + _HALF, _ZERO), _WHITE)
            )


def _bands(image: FloatArray) -> FloatArray:
    """Frequency bands [B, H, W] of an image [H, W], finest first."""
    levels = [image] + [
        np.asarray(cv2.GaussianBlur(image, (0, 0), BLUR_PX * edge), np.float32)
        for edge in BAND_EDGES[1:]
    ]
    return np.stack([fine - coarse for fine, coarse in itertools.pairwise(levels)])


def _contrast(image: FloatArray) -> FloatArray:
    """The local root mean square of detail [H, W]."""
    detail = image - wide_blur(image, COARSE_PX)
    contrast: FloatArray = np.sqrt(wide_blur(detail * detail, CONTRAST_PX) + np.float32(FLOOR**2))
    return contrast


def wide_blur(
    image: FloatArray,  # [H, W, 3] or [H, W], float32
    sigma_px: float,
) -> FloatArray:
    """A Gaussian blur, on the image at a half, a quarter ... of its size as far as `sigma_px`
    allows.
    """
    shrink = 1
    while sigma_px / (2 * shrink) >= FINEST_PX and min(image.shape[:2]) >= 4 * shrink:
        shrink *= 2
    height, width = image.shape[:2]
    small_size = (max(1, width // shrink), max(1, height // shrink))
    small = cv2.resize(image, small_size, interpolation=cv2.INTER_AREA) if shrink > 1 else image
    # Averaging over `shrink` pixels and interpolating between such averages blur, too: variances
    # add
    variance = (shrink**2 - 1) / 12 + (shrink**2) / 6 if shrink > 1 else 0.0
    blurred = cv2.GaussianBlur(small, (0, 0), np.sqrt(sigma_px**2 - variance) / shrink)
    return np.asarray(
        cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR)
        if shrink > 1
        else blurred
    )
