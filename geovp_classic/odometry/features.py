"""Shi-Tomasi corners, spread over the image and tracked from one image to the next."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry.optical_flow import track_points
from geovp_classic.types import BoolArray, ByteArray, FloatArray, IntArray


@dataclass(frozen=True)
class CornerTracker:
    """Shi-Tomasi corners, tracked by pyramidal Lucas-Kanade with a forward-backward check."""

    # Square cells of the image with at most one corner each: at 256x256, their side is 12 px,
    # about `window_px`, so that windows hardly overlap.
    num_features: int = 450
    # Smallest eigenvalue of a corner (Shi & Tomasi 1994), in the scale of OpenCV for an image
    # with a standard deviation of 255. Set by hand.
    min_corner_strength: float = 0.003
    # Grey values; an image with a smaller deviation has no corners but those of its noise.
    min_contrast: float = 1.5
    # Without corners: a window of `window_px` around one has to lie in the image, and stay there.
    border_px: int = 8
    # Wider images are searched for corners at half their size, in a quarter of the time. They have
    # more corners than cells at any size.
    half_size_from_px: int = 640
    # Windows of 11 px, of 88 px on the fourth level of the pyramid: tracks without a prediction may
    # be as long as half of that.
    window_px: int = 11
    num_levels: int = 4
    # with a prediction, which is good to a window's half width on the second level
    num_predicted_levels: int = 2
    # The end of the iteration: a tenth of `noise_px`, which few points need 12 steps for.
    max_iterations: int = 12
    min_step_px: float = 0.02
    # Of the forward-backward check (Kalal et al. 2010): two standard deviations of the noise
    max_return_px: float = 0.5
    # Standard deviation of a coordinate of a tracked corner. The median error of rendered images is
    # smaller (tests/geovp_classic/odometry/test_features.py); real windows are deformed as well.
    noise_px: float = 0.25
    # Relative change that is compensated before tracking: eight grey values at 100, above the noise
    # of the median and below a change that Lucas-Kanade mistakes for motion.
    min_exposure_change: float = 0.08
    # A window may differ by this times the median difference, plus these grey values, twice the
    # noise of a camera (`RoadAligner.grey_noise`).
    max_difference_ratio: float = 3.0
    max_difference_offset: float = 4.0
    # Points found near their predictions. With fewer, the others are searched in the whole pyramid.
    # With fewer still, all are, because the predictions are wrong.
    min_found_fraction: float = 0.5
    min_predicted_fraction: float = 0.3

    def __post_init__(self) -> None:
        if self.num_features < 50:
            raise BadData(f"num_features is {self.num_features}: expected at least 50")

    def detect(self, grey: ByteArray, mask: BoolArray | None = None) -> FloatArray:
        """Return all corners [M, 2] of an image [H, W], the strongest first.

        Masked pixels [H, W] and their neighbours have no corners.
        """
        contrast = np.std(grey[::4, ::4])
        if contrast < self.min_contrast:
            return np.zeros((0, 2))
        # Smaller eigenvalue of the structure tensor, independent of the contrast
        shrink = 1
        if grey.shape[1] >= self.half_size_from_px:
            shrink = 2
            grey = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        strength = cv2.cornerMinEigenVal(grey, 3) * (255 / contrast) ** 2
        border = self.border_px // shrink
        height, width = strength.shape
        inside = strength[border : height - border, border : width - border]
        strength = np.pad(inside, border)
        # Local maxima, the strongest first
        is_peak = strength >= cv2.dilate(strength, np.ones((5, 5), np.uint8))
        is_peak &= strength > self.min_corner_strength
        peak_rows, peak_columns = np.nonzero(is_peak)
        order = np.argsort(-strength[peak_rows, peak_columns], kind="stable")
        peaks = np.stack([peak_columns, peak_rows], axis=1)[order]
        corners = (peaks + 0.5) * shrink - 0.5
        if mask is None or not mask.any():
            return corners
        near = cv2.dilate(mask.astype(np.uint8), np.ones((self.window_px, self.window_px)))
        u, v = corners.astype(int).T
        return corners[near[v, u] == 0]

    def select(self, corners: FloatArray, occupied: FloatArray, image: ByteArray) -> FloatArray:
        """Return the strongest corner [K, 2] of every cell without any of the `occupied` points.

        The image [H, W] has about `num_features` square cells.
        """
        side_px = np.sqrt(image.size / self.num_features)
        indices, strongest = np.unique(_grid_indices(corners, side_px), return_index=True)
        is_free = ~np.isin(indices, _grid_indices(occupied, side_px))
        return corners[strongest[is_free]]

    def track(
        self,
        before: ByteArray,  # [H, W]
        now: ByteArray,  # [H, W]
        pixels: FloatArray,  # [N, 2] in the image before
        predicted: FloatArray,  # [N, 2] in the image now
    ) -> tuple[FloatArray, BoolArray]:
        """Return the points' pixels [N, 2] in the image now, and which were found [N].

        The search starts at the predictions with two levels of the pyramid. Pixels of points that
        were not found are finite but meaningless.
        """
        if len(pixels) == 0:
            return np.zeros((0, 2)), np.zeros(0, bool)
        images = (self.match_exposure(before, now), now)
        tracked, is_found = self._track(images, pixels, predicted, self.num_predicted_levels)
        if is_found.mean() < self.min_found_fraction:
            lost = ~is_found | (is_found.mean() < self.min_predicted_fraction)
            again, is_found_again = self._track(images, pixels[lost], pixels[lost], self.num_levels)
            tracked[lost] = again
            is_found[lost] = is_found_again
        return tracked, is_found

    def match_exposure(self, grey: ByteArray, reference: ByteArray) -> ByteArray:
        """Return the image with the exposure of another, if they differ noticeably.

        The gain is a median over cells of the images, so that new objects do not change it.
        """
        means, reference_means = (
            cv2.resize(image[::4, ::4], (16, 8), interpolation=cv2.INTER_AREA).astype(np.float32)
            for image in (grey, reference)
        )
        gain = float(np.median((reference_means + 1) / (means + 1)))
        if abs(gain - 1) < self.min_exposure_change:
            return grey
        return cv2.convertScaleAbs(grey, alpha=gain)

    def _track(
        self,
        images: tuple[ByteArray, ByteArray],
        pixels: FloatArray,
        predicted: FloatArray,
        num_levels: int,
    ) -> tuple[FloatArray, BoolArray]:
        tracked, is_found, difference = track_points(
            images,
            pixels,
            predicted,
            self.window_px,
            num_levels,
            termination=(self.max_iterations, self.min_step_px),
            max_return_px=self.max_return_px,
        )
        # Points outside, and windows that differ more than others, are lost
        tracked = np.nan_to_num(tracked.astype(np.float64))
        size_px = np.array(images[1].shape[1::-1])
        is_inside = (tracked >= 2) & (tracked < size_px - 2)
        is_found &= is_inside.all(axis=1)
        if is_found.any():
            usual = float(np.median(difference[is_found]))
            is_found &= difference < self.max_difference_ratio * usual + self.max_difference_offset
        return tracked, is_found


def _grid_indices(pixels: FloatArray, side_px: float) -> IntArray:
    """Return the numbers [N] of the square cells that hold pixels [N, 2]."""
    column, row = np.floor(pixels / side_px).astype(np.int64).T
    return row * 10_000 + column
