"""Broad Gaussian blurs, fast: what a wide blur leaves fits a smaller image."""

from __future__ import annotations

import cv2
import numpy as np

from geovp_classic.types import FloatArray

FINEST_PX = 2.0  # the standard deviation that is left to do on the smaller image; less would show its pixels


def broad(
    image: FloatArray,  # [H, W, 3] or [H, W], float32
    sigma_px: float,
) -> FloatArray:
    """The image after a Gaussian blur, done at a half, a quarter ... of its size as far as `sigma_px` allows."""
    shrink = 1
    while sigma_px / (2 * shrink) >= FINEST_PX and min(image.shape[:2]) >= 4 * shrink:
        shrink *= 2
    height, width = image.shape[:2]
    small_size = (max(1, width // shrink), max(1, height // shrink))
    small = cv2.resize(image, small_size, interpolation=cv2.INTER_AREA) if shrink > 1 else image
    # averaging over `shrink` pixels and interpolating between such averages blur, too: variances add
    own = (shrink**2 - 1) / 12 + (shrink**2) / 6 if shrink > 1 else 0.0
    blurred = cv2.GaussianBlur(small, (0, 0), np.sqrt(sigma_px**2 - own) / shrink)
    return np.asarray(cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR) if shrink > 1 else blurred)
