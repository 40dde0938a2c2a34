"""Depth completion: small islands of wrong matches, and pixels without a match, take the
background's depth.
"""

import cv2
import numpy as np

from geovp_classic.geometry.occlusion import background_pixels
from geovp_classic.types import BoolArray, FloatArray

SPECKLE_STEP = 2.0


def speckles(
    levels: FloatArray,  # [H, W], depth counted in hypotheses
    largest_share: float,
) -> BoolArray:
    """Islands [H, W] of at most that share of the image, cut off by steps of more than SPECKLE_STEP
    hypotheses.
    """
    sixteenths = np.round(16 * levels).astype(np.int16)
    marked = cv2.filterSpeckles(
        sixteenths, -1, int(largest_share * levels.size), int(16 * SPECKLE_STEP)
    )[0]
    islands: BoolArray = np.asarray(marked) == -1
    return islands


def fill_from_background(
    inverse_depth: FloatArray,  # [H, W]
    known: BoolArray,  # [H, W]
) -> FloatArray:
    """Unknown pixels get the farther of the next known depths left and right, else of those above
    and below.

    What one camera alone sees lies behind the object that hides it from the other. Where nothing is
    known all is 0.
    """
    if not known.any():
        return np.zeros(inverse_depth.shape, np.float32)
    return np.asarray(inverse_depth, np.float32).ravel()[background_pixels(known, -inverse_depth)]
