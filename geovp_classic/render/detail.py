"""Give magnified surfaces the fine detail back that one observed picture cannot hold.

A surface that is seen z times larger than it was observed has nothing above 1 / z of the finest frequency: roads, walls
and trees turn to blur, which perceptual metrics and people dislike more than wrong grain. While a car drives on, the
grain at one place of the picture changes little (road below, walls and trees beside). So the missing frequency bands
are borrowed from the last observed frame at the same place, with the contrast of what is there now. Bands are cut as in
a Laplacian pyramid (Burt & Adelson 1983).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import cv2
import numba
import numpy as np

from geovp_classic.render.blur import broad
from geovp_classic.types import ByteArray, FloatArray

BAND_EDGES = (1.0, 1.7, 2.7, 4.0, 6.0)  # magnifications between which each band is lost
BLUR_PX = 0.5  # standard deviation, per unit of magnification, of the blur that removes what is lost
COARSE_PX = 4.0  # detail is what a blur of this standard deviation removes
CONTRAST_PX = 6.0  # the neighbourhood in which contrasts are compared
FLOOR = 2.0  # grey levels of contrast below which nothing is amplified
LARGEST_GAIN = 1.0
_LOST = (
    np.array([(1.0, fine) for fine in BAND_EDGES[:-1]], np.float32) / np.diff(BAND_EDGES).astype(np.float32)[:, None]
)


@dataclass(frozen=True)
class Grain:
    """The frequency bands of an observed frame, finest first, and its local contrast."""

    bands: FloatArray  # [B, H, W, C] float32
    contrast: FloatArray  # [H, W, C]

    @classmethod
    def of(cls, frame: ByteArray) -> Grain:
        """The grain of a frame [H, W, C], in colour or in grey."""
        picture = frame.astype(np.float32)
        levels = [picture] + [_blurred(picture, BLUR_PX * edge) for edge in BAND_EDGES[1:]]
        bands = np.stack([fine - coarse for fine, coarse in itertools.pairwise(levels)])
        return cls(bands, _contrast(picture))

    def added_to(
        self,
        frame: ByteArray,  # [H, W, C]
        magnification: FloatArray,  # [H, W], 1 where nothing was lost
        strength: float = 1.0,
    ) -> ByteArray:
        """The frame with the bands that magnification took, at the contrast of what is there."""
        picture = frame.astype(np.float32)
        gain = np.minimum(_contrast(picture) / self.contrast, np.float32(LARGEST_GAIN))
        added = np.empty(frame.shape, np.uint8)
        _add(picture, self.bands, magnification.astype(np.float32), np.float32(strength) * gain, added)
        return added


@numba.njit(nogil=True, cache=True, fastmath=True, error_model="numpy")
def _add(
    picture: FloatArray,  # [H, W, C] float32
    bands: FloatArray,  # [B, H, W, C] float32
    magnification: FloatArray,  # [H, W] float32
    gain: FloatArray,  # [H, W, C] float32
    added: ByteArray,  # [H, W, C], written
) -> None:
    """Add to every pixel the share of each band that its magnification took."""
    height, width, colours = picture.shape
    share, zero, one, most = np.empty(len(bands), np.float32), np.float32(0), np.float32(1), np.float32(255)
    for row in range(height):
        for column in range(width):
            times = magnification[row, column]
            for b in range(len(bands)):
                share[b] = min(max(_LOST[b, 0] * times - _LOST[b, 1], zero), one)
            for colour in range(colours):
                missing = zero
                for b in range(len(bands)):
                    missing += share[b] * bands[b, row, column, colour]
                value = picture[row, column, colour] + gain[row, column, colour] * missing + np.float32(0.5)
                added[row, column, colour] = np.uint8(min(max(value, zero), most))


def _contrast(picture: FloatArray) -> FloatArray:
    """The local root mean square of detail [H, W, C]."""
    detail = picture - broad(picture, COARSE_PX).reshape(picture.shape)
    power = broad(detail * detail, CONTRAST_PX).reshape(picture.shape)
    contrast: FloatArray = np.sqrt(power + np.float32(FLOOR**2))
    return contrast


def _blurred(picture: FloatArray, sigma_px: float) -> FloatArray:
    blurred: FloatArray = np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px), np.float32)
    return blurred.reshape(picture.shape)  # OpenCV drops a single channel
