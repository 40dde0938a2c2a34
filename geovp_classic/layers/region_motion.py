"""Motion of a region in the image, found in dense flow and aligned with the images."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from geovp_classic.types import BoolArray, ByteArray, FloatArray

MAX_STEPS = 10  # of an alignment
MIN_STEP_PX = 0.02  # at the farthest frame; smaller ones end it
NOISE_GREY = 10.0  # of a pixel; larger differences count less (Huber)
FLOW_SIGMA = 1.0, 1.0, 0.1  # of the flow of a region: pixels, and growth, at the farthest frame


class EarlierFrame(NamedTuple):
    """An earlier frame, and where it shows the pixels of the last one."""

    image: ByteArray  # [H, W]
    elapsed_s: float  # to the last frame
    rotation: FloatArray  # homography [3, 3] from the last frame, of far points: K R K^-1
    static_px: FloatArray  # [H, W, 2], of the static scene
    is_in_front: BoolArray  # [H, W], of the camera

    def moved_px(self, pixels: FloatArray, motion_px_s: FloatArray) -> FloatArray:
        """Return where pixels [H, W, 2] with a motion into the past are."""
        moved = pixels + self.elapsed_s * motion_px_s
        return cv2.perspectiveTransform(moved.astype(np.float32), self.rotation)

    def shows(self, places_px: FloatArray) -> BoolArray:
        """Return which places [H, W, 2] lie in the image."""
        height, width = self.image.shape
        return np.asarray(cv2.inRange(places_px, (0, 0), (width - 1, height - 1)) > 0)


class RegionMotion(NamedTuple):
    """Motion of a region in the image into the past: that of its middle, and its growth."""

    middle: FloatArray  # [2], pixel
    shift_px_s: FloatArray  # [2]
    growth_per_s: float

    def at(self, pixels: FloatArray) -> FloatArray:
        """Return the motion [..., 2] of pixels."""
        return self.shift_px_s + self.growth_per_s * (pixels - self.middle)


def common_motion(
    mask: BoolArray,  # [H, W]
    motion_px_s: FloatArray,  # [H, W, 2], by dense flow
    max_s: float,
    max_misfit_px: float,  # after this time
) -> RegionMotion | None:
    """Return the motion that at least half of a region's pixels have; None without such a one.

    It is a similarity, by RANSAC: flow is wrong at occlusions, and a region may hold more than one
    object.
    """
    pixels = pixels_of(mask)[mask]
    earlier_px = pixels + np.float32(max_s) * motion_px_s[mask]
    similarity, agrees = cv2.estimateAffinePartial2D(
        pixels, earlier_px, method=cv2.RANSAC, ransacReprojThreshold=max_misfit_px
    )
    if similarity is None or agrees.mean() < 0.5:
        return None
    middle = pixels.mean(axis=0, dtype=np.float64)
    size = np.sqrt(np.linalg.det(similarity[:, :2]))  # in the earliest frame, over that in the last
    if not 0.3 < size < 3:
        return None
    shift_px = similarity @ [*middle, 1] - middle
    return RegionMotion(middle, shift_px / max_s, float(size - 1) / max_s)


def aligned(
    motion: RegionMotion,
    mask: BoolArray,  # [H, W]
    last: ByteArray,  # [H, W]
    earlier: Sequence[EarlierFrame],  # the farthest one is the last
) -> RegionMotion:
    """Align a region with all earlier frames at once (Lucas & Kanade 1981).

    Dense flow is smooth across the outline of a region. Its error of a fraction of a pixel would
    grow with the time that is predicted. A region without texture keeps the given motion, which is
    a prior.
    """
    rows, columns = np.nonzero(mask)
    box = tuple(slice(places.min(), places.max() + 1) for places in (rows, columns))
    pixels = pixels_of(last)[box]
    far_s = earlier[-1].elapsed_s
    prior = np.array([*motion.shift_px_s, motion.growth_per_s])
    precision = (NOISE_GREY * far_s / np.array(FLOW_SIGMA)) ** 2
    estimate = prior
    for _ in range(MAX_STEPS):
        # The normal equations of a Gauss-Newton step, first those of the prior
        normal, right = np.diag(precision), precision * (prior - estimate)
        for frame in earlier:
            # The region in this frame, moved back to its place in the last one
            places = frame.moved_px(pixels, motion.at(pixels))
            is_used = mask[box] & frame.shows(places)
            warped = cv2.remap(
                frame.image, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            # How the grey value of each pixel changes with shift and growth
            gradients = np.stack(
                [cv2.Scharr(warped, cv2.CV_32F, dx, 1 - dx, scale=1 / 32) for dx in (1, 0)], axis=-1
            )[is_used]
            along = (gradients * (pixels - motion.middle)[is_used]).sum(axis=1)
            jacobian = frame.elapsed_s * np.column_stack([gradients, along])
            # Differences beyond the noise count less (Huber)
            difference = last[box][is_used].astype(np.float64) - warped[is_used]
            weights = 1 / np.maximum(1, np.abs(difference) / NOISE_GREY)
            normal += (jacobian.T * weights) @ jacobian
            right += (jacobian.T * weights) @ difference
        step = np.linalg.solve(normal, right)
        estimate = estimate + step
        motion = RegionMotion(motion.middle, estimate[:2], float(estimate[2]))
        if np.abs(step[:2]).max() * far_s < MIN_STEP_PX:
            break
    return motion


def pixels_of(image: ByteArray | BoolArray) -> FloatArray:
    """Return the pixels (u, v) of an image [H, W], [H, W, 2] float32."""
    return np.stack(np.meshgrid(*map(np.arange, image.shape[::-1])), axis=-1).astype(np.float32)
