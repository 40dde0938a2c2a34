"""Frame screening: blank frames, duplicates, and frames before a cut to another scene."""

import itertools
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.optical_flow import track_points
from geovp_classic.types import BoolArray, ByteArray, FloatArray


@dataclass(frozen=True)
class FrameScreening:
    """Detection of frames without information; thresholds are in grey values of 0..255."""

    min_contrast: float = 4.0  # standard deviation; a frame with less is blank
    max_duplicate_difference: float = (
        0.3  # mean difference; noise and video coding exceed it
    )
    min_motion_difference: float = (
        3.0  # of a moving camera; no change after it is a fault
    )
    min_cut_change: float = (
        1.25  # times the median change of the clip, at a cut
    )
    max_cut_tracked_fraction: float = (
        0.2  # of the corners; in streets at least half are tracked
    )
    cut_height_px: int = 96  # of the small images in which a cut is looked for
    cut_num_corners: tuple[int, int] = (15, 80)  # fewest and most corners there
    cut_window_px: int = 11  # of Lucas-Kanade there

    def usable(
        self,
        greys: ByteArray,  # [P, H, W]
    ) -> BoolArray:
        """Return which frames [P] carry information; all of them if fewer than two do."""
        usable = np.array(
            [
                cv2.meanStdDev(grey)[1].item() > self.min_contrast
                for grey in greys
            ]
        )
        previous_change = 0.0
        for before, now in itertools.pairwise(np.flatnonzero(usable)):
            change = _difference(greys[before], greys[now])
            is_duplicate = change < self.max_duplicate_difference
            usable[now] = not (
                is_duplicate and previous_change >= self.min_motion_difference
            )
            if not is_duplicate:
                previous_change = change
        steps = np.flatnonzero(usable)
        usable[steps[: self._first_after_last_cut(greys[steps])]] = False
        return usable if usable.sum() >= 2 else np.ones(len(greys), dtype=bool)

    def _first_after_last_cut(self, greys: ByteArray) -> int:
        """Return the index of the first grey image after the last cut; 0 without a cut.

        At a cut no image before matches one after, which a single bad image cannot cause.
        """
        pairs = list(itertools.pairwise(range(len(greys))))
        changes = np.array([_difference(greys[a], greys[b]) for a, b in pairs])
        for a, b in reversed(pairs[:-1]):
            if changes[a] <= self.min_cut_change * np.median(changes):
                continue
            across = [(a, b), (a, b + 1), (max(a - 1, 0), b)]
            tracked = (
                self._tracked_fraction(greys[i], greys[j]) for i, j in across
            )
            if all(
                fraction < self.max_cut_tracked_fraction for fraction in tracked
            ):
                return b
        return 0

    def _tracked_fraction(
        self, before_grey: ByteArray, now_grey: ByteArray
    ) -> float:
        """Return the fraction of corners tracked there and back; 1 if there are too few."""
        min_corners, max_corners = self.cut_num_corners
        before = self._normalised(before_grey)
        now = self._normalised(now_grey)
        corners = cv2.goodFeaturesToTrack(before, max_corners, 0.01, 5)
        if corners is None or len(corners) < min_corners:
            return 1.0
        pixels = np.asarray(corners.reshape(-1, 2), np.float32)
        return track_points((before, now), pixels, pixels, self.cut_window_px)[
            1
        ].mean()

    def _normalised(self, grey: ByteArray) -> ByteArray:
        """Return a small image of fixed mean and contrast, independent of exposure."""
        size_px = (
            round(grey.shape[1] * self.cut_height_px / len(grey)),
            self.cut_height_px,
        )
        small = cv2.resize(
            grey.astype(np.float32), size_px, interpolation=cv2.INTER_AREA
        )
        normalised = (small - small.mean()) / max(small.std(), 1e-3)
        return np.clip(128 + 48 * normalised, 0, 255).astype(np.uint8)


def _difference(before: ByteArray, now: ByteArray) -> float:
    """Return the mean absolute difference of two grey images."""
    return cv2.norm(before, now, cv2.NORM_L1) / before.size


def bridged(
    world_from_cam: FloatArray,  # [P, 4, 4]
    times_s: FloatArray,  # [P]
    is_valid: BoolArray,  # [P]
) -> FloatArray:
    """Interpolate invalid poses at constant twist; return them unchanged with fewer than two valid.

    Poses before the first or after the last valid one are extrapolated.
    """
    steps = np.flatnonzero(is_valid)
    if len(steps) < 2:
        return world_from_cam
    poses = se3.interpolate(world_from_cam[steps], times_s[steps], times_s)
    return np.where(is_valid[:, None, None], world_from_cam, poses)
