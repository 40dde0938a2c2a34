"""Motion segmentation: pixels where an object's motion explains the images and a static background
does not.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.dynamic_objects.posed_images import Box, PosedImages
from geovp_classic.types import BoolArray, FloatArray


@dataclass(frozen=True)
class MotionSegmentation:
    """Segmentation of an object at one depth by photometric errors."""

    window_px: int = 3  # over which grey differences are averaged
    # The object must explain a pixel better than the background by so many grey values,
    min_gain_grey: float = 1.0
    min_gain_fraction: float = 0.25  # plus this fraction of its own error
    max_height: float = 1.35  # camera heights; vans, seen by a car's camera
    side_fraction: float = (
        0.4  # of the evidence's extent, by which an object may exceed it
    )
    below_px: int = 2  # the evidence
    margin_px: int = 1  # around the mask
    min_explained_fraction: float = 0.4  # of the evidence

    def segment(
        self,
        evidence: BoolArray,  # [H, W]
        depth: float,
        velocity: FloatArray,  # [3] in the last camera's frame
        observed: PosedImages,
    ) -> BoolArray | None:
        """Return the mask [H, W] of an object; None when its motion does not explain the evidence.

        The mask is convex: uniform doors and panes match anywhere.
        """
        box = self._box(evidence, depth, observed)
        seed = evidence[box]
        background = self._background(seed, box, observed)
        body = np.full(seed.shape, 1 / depth)
        is_better = np.ones(seed.shape, bool)
        for step in observed.steps:
            moving_error = observed.motion_difference(
                step, box, body, velocity, self.window_px
            )
            static_error = observed.motion_difference(
                step, box, background, np.zeros(3), self.window_px
            )
            min_gain = (
                self.min_gain_grey + self.min_gain_fraction * moving_error
            )
            is_better &= static_error - moving_error > min_gain
        if is_better[seed].mean() < self.min_explained_fraction:
            return None
        mask = np.zeros(evidence.shape, bool)
        mask[box] = self._convex(_connected_to(is_better, seed & is_better))
        return mask

    def photometric_error(
        self,
        body: BoolArray,  # [H, W]
        depth: float,
        velocity: FloatArray,
        observed: PosedImages,
    ) -> float:
        """Return the mean grey difference between a body and earlier frames, where it was then."""
        box = bounding_box(body)
        mask = body[box]
        inverse_depth = np.full(mask.shape, 1 / depth)
        errors = [
            observed.motion_difference(
                step, box, inverse_depth, velocity, self.window_px
            )[mask]
            for step in observed.steps
        ]
        return float(np.mean(errors))

    def _box(
        self, evidence: BoolArray, depth: float, observed: PosedImages
    ) -> Box:
        """Return the box where the object may be: around the evidence, and as high as vehicles."""
        height, width = evidence.shape
        rows, columns = bounding_box(evidence)
        extent = max(rows.stop - rows.start, columns.stop - columns.start)
        aside_px = int(self.side_fraction * extent)
        bottom = min(rows.stop + self.below_px, height)
        height_px = (
            self.max_height
            * observed.road.height
            * observed.camera.fy_px
            / depth
        )
        top = max(min(int(bottom - height_px), rows.start), 0)
        left = max(columns.start - aside_px, 0)
        right = min(columns.stop + aside_px, width)
        return slice(top, bottom), slice(left, right)

    def _background(
        self, seed: BoolArray, box: Box, observed: PosedImages
    ) -> FloatArray:
        """Return the background's inverse depth [h, w] in the box.

        In the columns of the evidence it is interpolated between both sides of the box, because
        the depth there was estimated from the object as if it were static.
        """
        rows, columns = box
        width = observed.inverse_depth.shape[1]
        left_column = max(columns.start - 1, 0)
        right_column = min(columns.stop, width - 1)
        left = observed.inverse_depth[rows, left_column]
        right = observed.inverse_depth[rows, right_column]
        interpolated = np.linspace(
            left, right, columns.stop - columns.start, axis=1
        )
        background = observed.inverse_depth[box].copy()
        _, inner = bounding_box(seed)
        background[:, inner] = interpolated[:, inner]
        return background

    def _convex(self, mask: BoolArray) -> BoolArray:
        """Return the convex hull of a mask [h, w], widened by a margin."""
        hull = cv2.convexHull(cv2.findNonZero(mask.astype(np.uint8)))
        filled = np.zeros(mask.shape, np.uint8)
        cv2.fillConvexPoly(filled, hull, 1)
        size_px = 2 * self.margin_px + 1
        kernel = np.ones((size_px, size_px), np.uint8)
        return np.asarray(cv2.dilate(filled, kernel) > 0)


def bounding_box(mask: BoolArray) -> Box:
    """Return the smallest box with all pixels of a mask [H, W]."""
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return slice(top, top + height), slice(left, left + width)


def _connected_to(mask: BoolArray, seed: BoolArray) -> BoolArray:
    """Return the parts of the mask [H, W] that are connected to the seed."""
    kernel = np.ones((5, 5), np.uint8)
    bridged = cv2.dilate(mask.astype(np.uint8), kernel)
    _, labels = cv2.connectedComponents(bridged)
    return np.asarray(mask & np.isin(labels, labels[seed]))
