"""Extrapolation of one homography between the last two observed frames."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.linalg import fractional_matrix_power

from geovp_classic.errors import Incompatible
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.interfaces import Inpainter
from geovp_classic.odometry.features import CornerTracker
from geovp_classic.predictors.image_warping import last_greys, warped_prediction
from geovp_classic.types import ByteArray, Context, FloatArray, Prediction, PrivilegedInput


@dataclass(frozen=True)
class HomographyExtrapolation:
    """Repetition of the last motion of the image as a whole: one homography per frame.

    It is exact for a rotating camera or a planar scene. Pixels from outside of the last frame are
    inpainted.
    """

    corners: CornerTracker = CornerTracker()
    inpainter: Inpainter = DetailTransfer()
    # Of the homography's inliers (MAGSAC++, Barath et al. 2020); on val, 1 and 3 px do the same.
    max_error_px: float = 1.0
    # Four determine a homography; these are twice as many.
    min_inliers: int = 8

    needs = PrivilegedInput.NONE

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Predict one sample; raise Incompatible without two usable frames or enough corners."""
        (before, now), times_s, last = last_greys(context)
        before_from_now = self._homography(before, now)
        ahead_s = context.future_s - times_s[-1]
        at_infinity = np.zeros(now.shape, np.float32)
        maps = []
        for num_steps in ahead_s / np.diff(times_s):
            power = fractional_matrix_power(before_from_now, num_steps).real
            power = power.astype(np.float32)
            homography = Epipolar(power, np.zeros(3, np.float32))
            pixels, depth_ratio = homography.project(at_infinity)
            maps.append((pixels, depth_ratio > 0))
        return warped_prediction(last, maps, self.inpainter)

    def _homography(self, before: ByteArray, now: ByteArray) -> FloatArray:
        """Return the homography [3, 3] from an image to the one before it, with determinant 1."""
        corners = self.corners.select(self.corners.detect(before), np.zeros((0, 2)), before)
        tracked, is_tracked = self.corners.track(before, now, corners, corners)
        homography, num_inliers = None, 0
        if is_tracked.sum() >= self.min_inliers:
            homography, inliers = cv2.findHomography(
                tracked[is_tracked],
                corners[is_tracked],
                cv2.USAC_MAGSAC,
                self.max_error_px,
            )
            num_inliers = np.sum(inliers)
        if homography is None or num_inliers < self.min_inliers:
            raise Incompatible(
                f"homography-extrapolation found {num_inliers} corners with one motion, "
                f"expected {self.min_inliers} or more: give sharper or larger frames"
            )
        return homography / np.cbrt(np.linalg.det(homography))
