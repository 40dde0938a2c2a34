"""Frame screening: blank frames, duplicates, and frames before a cut to another scene."""

import itertools
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry.optical_flow import track_points
from geovp_classic.types import BoolArray, ByteArray


@dataclass(frozen=True)
class FrameScreening:
    """Detection of frames without information; thresholds are in grey values of 0..255."""

    # Standard deviation; a frame with less is blank: two to four times the noise of a camera.
    min_contrast: float = 4.0
    # Mean difference; noise and video coding exceed it.
    max_duplicate_difference: float = 0.3
    # Mean difference of a moving camera; no change after it is a fault. Ten times a duplicate's.
    min_motion_difference: float = 3.0
    # Change at a cut, over the median change of the clip. Set by hand: it selects what is tracked.
    min_cut_change: float = 1.25
    # Of the corners, across a cut, where they match by chance; in streets half or more are tracked.
    max_cut_tracked_fraction: float = 0.2
    # Of the images in which cuts are detected: motion is a few pixels there. No false cut in 370
    # windows of KITTI.
    cut_height_px: int = 96
    min_cut_corners: int = 15  # with fewer there is no evidence of a cut: 3 are a fifth
    max_cut_corners: int = 80  # the deviation of their tracked fraction is below .05
    cut_window_px: int = 11  # of Lucas-Kanade, a ninth of the height
    cut_corner_quality: float = 0.01  # of the best corner, as in OpenCV's examples
    cut_corner_spacing_px: int = 5  # half a window

    def usable(
        self,
        greys: ByteArray,  # [P, H, W]
    ) -> BoolArray:
        """Return which frames [P] carry information; all of them if fewer than two do."""
        # Blank frames; then duplicates, which are a fault only while the camera moves.
        contrast = np.array([grey.std() for grey in greys])
        usable = contrast > self.min_contrast
        previous_change = 0.0
        for before, now in itertools.pairwise(np.flatnonzero(usable)):
            change = _difference(greys[before], greys[now])
            if change >= self.max_duplicate_difference:
                previous_change = change
            elif previous_change >= self.min_motion_difference:
                usable[now] = False
        # Frames before the last cut show another scene.
        steps = np.flatnonzero(usable)
        usable[steps[: self._last_cut(greys[steps])]] = False
        return usable if usable.sum() >= 2 else np.ones(len(greys), bool)

    def _last_cut(self, greys: ByteArray) -> int:
        """Return the index of the first grey image after the last cut; 0 without a cut.

        At a cut no image before matches one after, which a single bad image cannot cause.
        """
        if len(greys) < 3:
            return 0
        pairs = itertools.pairwise(greys)
        changes = np.array([_difference(*pair) for pair in pairs])
        is_large = changes > self.min_cut_change * np.median(changes)
        for before in np.flatnonzero(is_large[:-1])[::-1]:
            now = before + 1
            across = (
                (before, now),
                (before, now + 1),
                (max(before - 1, 0), now),
            )
            if not any(self._match(greys[i], greys[j]) for i, j in across):
                return int(now)
        return 0

    def _match(self, before: ByteArray, now: ByteArray) -> bool:
        """Return whether corners can be tracked between two images and back."""
        images = self._normalised(before), self._normalised(now)
        corners = cv2.goodFeaturesToTrack(
            images[0],
            self.max_cut_corners,
            self.cut_corner_quality,
            self.cut_corner_spacing_px,
        )
        if corners is None or len(corners) < self.min_cut_corners:
            return True
        pixels = corners.reshape(-1, 2)
        _, is_tracked, _ = track_points(images, pixels, pixels, self.cut_window_px)
        return bool(is_tracked.mean() >= self.max_cut_tracked_fraction)

    def _normalised(self, grey: ByteArray) -> ByteArray:
        """Return a small image of fixed contrast, independent of exposure."""
        width_px = round(grey.shape[1] * self.cut_height_px / len(grey))
        small = cv2.resize(grey, (width_px, self.cut_height_px), interpolation=cv2.INTER_AREA)
        return cv2.equalizeHist(small)


def _difference(before: ByteArray, now: ByteArray) -> float:
    """Return the mean absolute difference of two grey images."""
    return cv2.norm(before, now, cv2.NORM_L1) / before.size
