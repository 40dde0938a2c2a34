"""Detection of a stationary camera, behind moving objects or noise."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry.optical_flow import track_points
from geovp_classic.types import ByteArray, FloatArray


@dataclass(frozen=True)
class Stationarity:
    """Check whether the street stays in place, however much of the image moves in front of it.

    Corners of the last image must be in the same place in three earlier ones over much of the
    image. Hardly any may have moved a little, as those of a creeping camera do. In 104 clips of a
    driving car, no corner stays in place.
    """

    min_corners: int = 20
    max_corners: int = 150
    window_px: int = 11
    # rows by the image's height: below captions, above the ego vehicle and most others
    first_row: float = 0.1
    last_row: float = 0.5
    max_shift_px: float = 0.25  # of a corner that stays in place
    max_slow_shift_px: float = 5.0
    max_slow_ratio: float = (
        0.5  # of the number of slow corners to those in place
    )
    min_fraction: float = 0.2  # of the corners, in place
    # extent of the corners in place by the image's size; a vehicle that is followed is narrower
    min_width_fraction: float = 0.5
    min_height_fraction: float = 0.08
    # White noise: a mean over n x n pixels has 1 / n^2 of its variance, but most of that of
    # textures, which are correlated from pixel to pixel, once they have moved.
    noise_block_px: int = 8
    min_noise_variance: float = (
        9.0  # of the change from the first to the second half
    )
    max_block_variance_ratio: float = 1.5  # to that of white noise

    def is_stationary(self, greys: ByteArray) -> bool:
        """Return whether the camera of images [P, H, W] is stationary."""
        return self.is_white_noise(greys) or self._stays_in_place(greys)

    def is_white_noise(self, greys: ByteArray) -> bool:
        """Return whether images [P, H, W] differ much, and by white noise alone."""
        half = len(greys) // 2
        height, width = greys[0].shape
        size = (width // self.noise_block_px, height // self.noise_block_px)
        if half == 0 or min(size) == 0:
            return False
        change: FloatArray = np.mean(greys[-half:], axis=0, dtype=np.float32)
        change = change - np.mean(greys[:half], axis=0, dtype=np.float32)
        blocks = cv2.resize(change, size, interpolation=cv2.INTER_AREA)
        variance = float(change.var())
        block_variance = float(blocks.var()) * self.noise_block_px**2
        is_white = block_variance < self.max_block_variance_ratio * variance
        return variance > self.min_noise_variance and is_white

    def _stays_in_place(self, greys: ByteArray) -> bool:
        height, width = greys[0].shape
        greys = greys[
            :, round(self.first_row * height) : round(self.last_row * height)
        ]
        corners = cv2.goodFeaturesToTrack(
            greys[-1], self.max_corners, 0.01, height / 32
        )
        if len(greys) < 4 or corners is None or len(corners) < self.min_corners:
            return False
        pixels = np.asarray(corners.reshape(-1, 2), np.float32)
        max_shift_px = np.zeros(len(pixels))
        for step in (0, len(greys) // 3, 2 * len(greys) // 3):
            tracked, is_found, _ = track_points(
                (greys[-1], greys[step]), pixels, pixels, self.window_px, (1, 1)
            )
            shift_px = np.where(
                is_found, np.linalg.norm(tracked - pixels, axis=1), np.inf
            )
            max_shift_px = np.maximum(max_shift_px, shift_px)
        in_place = max_shift_px < self.max_shift_px
        num_slow = (
            max_shift_px < self.max_slow_shift_px
        ).sum() - in_place.sum()
        if in_place.mean() < self.min_fraction:
            return False
        if num_slow > self.max_slow_ratio * in_place.sum():
            return False
        low, high = np.percentile(pixels[in_place], (10, 90), axis=0)
        min_extent = (
            self.min_width_fraction * width,
            self.min_height_fraction * height,
        )
        return bool((high - low > min_extent).all())
