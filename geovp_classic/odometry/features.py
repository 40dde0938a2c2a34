"""Shi-Tomasi corners, spread over the image and tracked from one image to the next."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry.optical_flow import track_points
from geovp_classic.geometry.robust import median
from geovp_classic.types import BoolArray, ByteArray, FloatArray, IntArray

NOISE_PX = 0.25  # standard deviation of a coordinate of a tracked corner
# smallest eigenvalue of a corner worth tracking, for an image of variance 1 (OpenCV's scale)
MIN_CORNER = 0.003
MIN_CONTRAST = 1.5  # grey values; an image with a smaller standard deviation has no features
EXPOSURE_CHANGE = 0.08  # a larger relative change of brightness is undone before tracking
MAX_ERROR_RATIO, MAX_ERROR_OFFSET = (
    3.0,
    4.0,
)  # a patch may differ by this times the median plus these grey values
MIN_FOUND_SHARE = 0.3  # with fewer points found near the predictions, the predictions are discarded
ENOUGH_FOUND_SHARE = 0.5  # with more found there, the others are taken for lost
TERMINATION = (12, 0.02)  # iterations and pixels of a step after which Lucas-Kanade ends
THINNED_WIDTH_PX = 320  # columns that are enough to compare exposures
HALF_FROM_WIDTH_PX = 640  # wider images are searched for corners at half their size


@dataclass(frozen=True)
class CornerTracker:
    """Shi-Tomasi corners, tracked by pyramidal Lucas-Kanade with a forward-backward check."""

    num_features: int = 450
    window_px: int = 11
    num_levels: int = 4
    max_return_px: float = (
        0.5  # largest distance between a point and where tracking it there and back ends
    )

    def track(
        self,
        before: ByteArray,  # [H, W]
        now: ByteArray,  # [H, W]
        pixels: FloatArray,  # [N, 2] in the image before
        predicted: FloatArray,  # [N, 2] in the image now
    ) -> tuple[FloatArray, BoolArray]:
        """The points' pixels [N, 2] in the image now, and which were found [N].

        Lucas-Kanade starts from the predictions; points lost that way are searched in the whole
        pyramid, from where they were. Pixels of points that were not found are finite but
        meaningless.
        """
        before = match_exposure(before, now)
        tracked, found = self._track(before, now, pixels, predicted, num_levels=2)
        if len(pixels) == 0 or found.mean() > ENOUGH_FOUND_SHARE:
            return tracked, found
        if found.mean() < MIN_FOUND_SHARE:
            return self._track(before, now, pixels, pixels, self.num_levels)
        tracked[~found], found[~found] = self._track(
            before, now, pixels[~found], pixels[~found], self.num_levels
        )
        return tracked, found

    def detect(
        self, grey: ByteArray, occupied: FloatArray, corners: FloatArray | None = None
    ) -> FloatArray:
        """New corners [K, 2]: the strongest one of every cell of the image without one of the
        points `occupied`.

        `corners` [M, 2] are those of `all_corners`, where they are known already.
        """
        return _spread(
            grey, all_corners(grey) if corners is None else corners, occupied, self.num_features
        )

    def _track(
        self,
        before: ByteArray,
        now: ByteArray,
        pixels: FloatArray,
        predicted: FloatArray,
        num_levels: int,
    ) -> tuple[FloatArray, BoolArray]:
        if len(pixels) == 0:
            return np.zeros((0, 2)), np.zeros(0, dtype=bool)
        ahead, found, error = track_points(
            (before, now),
            pixels,
            predicted,
            self.window_px,
            (num_levels, 1),
            TERMINATION,
            self.max_return_px,
        )
        tracked = np.nan_to_num(ahead.astype(np.float64))
        found &= inside(tracked, now)
        if found.any():
            found &= error < MAX_ERROR_RATIO * median(error[found]) + MAX_ERROR_OFFSET
        return tracked, found


def match_exposure(grey: ByteArray, reference: ByteArray) -> ByteArray:
    """The image with the brightness of another, when their exposures differ noticeably.

    The gain is a median over cells of the images: new objects in a part of them don't count as
    exposure.
    """
    every = max(1, grey.shape[1] // THINNED_WIDTH_PX)
    thinned = [np.ascontiguousarray(image[::every, ::every]) for image in (grey, reference)]
    small = [
        cv2.resize(image, (16, 8), interpolation=cv2.INTER_AREA).astype(np.float32)
        for image in thinned
    ]
    usable = (np.minimum(*small) > 4) & (np.maximum(*small) < 251)  # neither black nor saturated
    if usable.mean() < 0.25:
        return grey
    gain = float(np.median(small[1][usable] / small[0][usable]))
    if abs(gain - 1) < EXPOSURE_CHANGE:
        return grey
    return np.asarray(cv2.convertScaleAbs(grey, alpha=gain), dtype=np.uint8)


def all_corners(grey: ByteArray) -> FloatArray:
    """All corners [M, 2] of an image [H, W], the strongest first."""
    shrink = 2 if grey.shape[1] >= HALF_FROM_WIDTH_PX else 1
    small = (
        grey
        if shrink == 1
        else cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    )
    contrast = float(np.std(grey[::4, ::4]))
    if contrast < MIN_CONTRAST:
        return np.zeros((0, 2))
    strength = cv2.cornerMinEigenVal(small, 3) * (255 / contrast) ** 2
    border = 8 // shrink
    strength[:border], strength[-border:], strength[:, :border], strength[:, -border:] = 0, 0, 0, 0
    peaks = (strength > MIN_CORNER) & (strength >= cv2.dilate(strength, np.ones((5, 5), np.uint8)))
    rows, columns = np.divmod(np.flatnonzero(peaks), small.shape[1])
    order = np.argsort(-strength[rows, columns], kind="stable")
    return np.asarray((np.stack([columns, rows], axis=1)[order] + 0.5) * shrink - 0.5)


def _spread(grey: ByteArray, corners: FloatArray, occupied: FloatArray, count: int) -> FloatArray:
    """Corners [K, 2], at most one in each of about `count` square cells, none in cells with a point
    of `occupied`.
    """
    side_px = np.sqrt(grey.size / max(count, 1))
    per_row = int(grey.shape[1] // side_px) + 1
    cells, strongest = np.unique(_cell(corners, side_px, per_row), return_index=True)
    return corners[strongest[~np.isin(cells, _cell(occupied, side_px, per_row))]]


def inside(pixels: FloatArray, grey: ByteArray, margin_px: float = 2.0) -> BoolArray:
    """Which points [N] lie in the image, `margin_px` from its edges."""
    size_px = np.array(grey.shape[1::-1])
    return np.asarray(((pixels >= margin_px) & (pixels < size_px - margin_px)).all(axis=1))


def _cell(pixels: FloatArray, side_px: float, per_row: int) -> IntArray:
    column, row = np.floor(np.reshape(pixels, (-1, 2)) / side_px).astype(np.int64).T
    return row * per_row + column
