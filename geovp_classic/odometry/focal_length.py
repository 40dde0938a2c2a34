"""Focal length of an unknown camera from its motion, with the principal point at the centre.

A map is tracked with a wrong focal length and then bundle-adjusted together with it. This moves the
focal length towards the right one, but only part of the way, because the inliers agree with the
wrong one. The step is zero at the right focal length, so its zero is searched. Pixels are assumed
to be square, and without distortion. Motion without any rotation is uninformative: a longer focal
length and a faster camera give the same images.
"""

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.geometry.bundle_adjustment import adjust_focal
from geovp_classic.observation import Observer
from geovp_classic.observation.scene_mask import scene_window
from geovp_classic.odometry.tracking import Image, Tracker, TrackerSettings
from geovp_classic.parallel import parallel_map, single_threaded_blas
from geovp_classic.types import ByteArray, Intrinsics

NORMAL_QUANTILE = 1.645  # of a 90 % interval, in standard deviations


@dataclass(frozen=True)
class FocalLength:
    """A focal length with its 90 % interval."""

    focal_px: float
    low_px: float
    high_px: float
    num_windows: int  # that were informative
    # Standard deviation relative to the focal length. Set by hand: a tenth moves what the camera
    # turns into view by a tenth.
    max_sure_error: float = 0.1

    @property
    def is_sure(self) -> bool:
        """Return whether the standard deviation is small enough for prediction."""
        max_width = 2 * NORMAL_QUANTILE * self.max_sure_error
        return bool(np.log(self.high_px / self.low_px) < max_width)


@dataclass(frozen=True)
class FocalLengthEstimator:
    """Search of the focal length that bundle adjustment leaves unchanged."""

    # Images of a window: 3 s at KITTI's rate, of a turn or of the bends of a street
    window: int = 30
    # Of a window; half as many agree with wrong focal lengths too often.
    min_images: int = 15
    # Focal lengths by image width, for fields of view of 110 to 33 degrees, from action
    # cameras to short telephoto lenses
    start_ratios: tuple[float, ...] = (0.35, 0.6, 1.0, 1.7)
    # Of the search between two of these (regula falsi); each takes a bundle adjustment.
    max_rounds: int = 4
    # Of the logarithm, which ends the search: less than half of `systematic_error`
    max_step: float = 0.01
    # Of the logarithm. Errors on KITTI times slope are 0.006 (rms).
    step_noise: float = 0.008
    # Relative, by a principal point that is not at the centre. On 22 windows of 30 frames of KITTI
    # the error is at most 6.5 %, which is 2.6 times this.
    systematic_error: float = 0.025
    # A focal length and the poses of fewer keyframes fit any tracks.
    min_keyframes: int = 5
    # With most observations, in the bundle adjustment: more than the odometry's, since it is not
    # repeated at every keyframe.
    num_points: int = 500
    tracking: TrackerSettings = TrackerSettings()

    @single_threaded_blas
    def estimate(self, windows: Iterable[Sequence[ByteArray]]) -> FocalLength | None:
        """Return the focal length of grey images [H, W], from windows of consecutive ones.

        The result is None if no window is informative.
        """
        roots = [self._root(window) for window in windows if len(window) >= self.min_images]
        informative = [root for root in roots if root is not None]
        if not informative:
            return None
        # Weighted mean of all windows; its variance covers their scatter
        logs, sds = np.array(informative).T
        weight = 1 / sds**2
        mean = float(np.average(logs, weights=weight))
        scatter = (weight * (logs - mean) ** 2).sum() / max(len(logs) - 1, 1)
        variance = max(scatter, 1.0) / weight.sum() + self.systematic_error**2
        half = NORMAL_QUANTILE * np.sqrt(variance)
        low, focal, high = np.exp([mean - half, mean, mean + half]).tolist()
        return FocalLength(focal, low, high, len(logs))

    def _root(self, greys: Sequence[ByteArray]) -> tuple[float, float] | None:
        """Return the logarithm of the focal length with a step of zero, and its deviation."""
        height_px, width_px = greys[0].shape
        mask, _ = Observer().scene(np.stack(greys))
        window = scene_window(mask)  # without the ego vehicle
        greys = [grey[window] for grey in greys]
        corners = parallel_map(self.tracking.corners.detect, greys)
        images = list(map(Image, greys, corners, range(len(greys))))
        rows, columns = window
        height, width = greys[0].shape
        centre = ((width_px - 1) / 2, (height_px - 1) / 2)

        @functools.cache
        def step(log_focal: float) -> float:
            focal_px = float(np.exp(log_focal))
            whole = Intrinsics(focal_px, focal_px, *centre, width_px, height_px)
            camera = whole.cropped(columns.start, rows.start, width, height)
            adjusted_px = self._adjusted_focal(images, camera)
            return float(np.log(adjusted_px)) - log_focal

        # Bracket the zero: the step is positive for short focal lengths, then negative
        starts = np.log(np.multiply(self.start_ratios, width)).tolist()
        starts = [start for start in starts if np.isfinite(step(start))]
        is_longer = [step(start) > 0 for start in starts]
        num_longer = sum(is_longer)
        if not 0 < num_longer < len(starts) or not all(is_longer[:num_longer]):
            return None
        # Regula falsi; the step's slope tells how well the zero is determined
        low, high = starts[num_longer - 1 : num_longer + 1]
        slope = (step(low) - step(high)) / (high - low)
        for _ in range(self.max_rounds):
            middle = low + (high - low) * step(low) / (step(low) - step(high))
            if not abs(step(middle)) > self.max_step:  # or NaN
                break
            if step(middle) > 0:
                low = middle
            else:
                high = middle
        return middle, self.step_noise / slope

    def _adjusted_focal(self, images: list[Image], camera: Intrinsics) -> float:
        """Return the focal length that bundle adjustment ends at, or NaN."""
        keyframes = self.tracking.keyframes.for_clip(len(images))
        tracker = Tracker(replace(self.tracking, keyframes=keyframes), camera)
        for image in images:
            tracker.push(image)
        tracks = tracker.map
        if len(tracks.keyframes) < self.min_keyframes:
            return np.nan
        index = tracks.adjustable()[: self.num_points]
        points = tracks.points[index]
        pixels = tracks.observations[:, index]
        return adjust_focal(tracks.cam_from_world, points, pixels, camera)
