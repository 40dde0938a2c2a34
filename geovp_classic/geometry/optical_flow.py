"""Optical flow: sparse tracks with a forward-backward check, and dense flow.

Tracks: pyramidal Lucas-Kanade (Lucas & Kanade 1981; Kalal et al. 2010). The way back must not start
at the answer: a search that starts at the point itself often stays there, whatever the way forward
found. It starts where the predicted motion, reversed, leads from the point that was found.
"""

import functools

import cv2
import numpy as np

from geovp_classic.types import BoolArray, ByteArray, FloatArray

MIN_DENSE_PX = 16  # of a side; smaller images, and narrower ones than 1:3, crash OpenCV's DIS


def dense_flow(
    source: ByteArray,  # [H, W]
    target: ByteArray,  # [H, W]
    preset: int,  # cv2.DISOPTICAL_FLOW_PRESET_...
) -> FloatArray:
    """Return the flow [H, W, 2] from an image to another, in pixels (DIS, Kroeger et al. 2016)."""
    height, width = source.shape
    # Narrow images are continued, since their pyramid has levels that are smaller than a patch.
    side = max(MIN_DENSE_PX, -(-max(height, width) // 3))
    margin = (0, max(0, side - height), 0, max(0, side - width))
    first = cv2.copyMakeBorder(source, *margin, cv2.BORDER_REPLICATE)
    second = cv2.copyMakeBorder(target, *margin, cv2.BORDER_REPLICATE)
    flow = cv2.DISOpticalFlow.create(preset).calc(first, second, None)
    return np.asarray(flow)[:height, :width]


def track_points(
    images: tuple[ByteArray, ByteArray],  # [H, W] each, before and now
    pixels: FloatArray,  # [N, 2] in the image before, N >= 1
    predicted: FloatArray,  # [N, 2] in the image now, where the search starts
    window_px: int,
    num_levels: int = 4,  # of the pyramids
    termination: tuple[int, float] = (30, 0.01),  # iterations, pixels of a step
    max_return_px: float = 0.5,  # between a point and where tracking it back ends
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Track points from one image to the next.

    Return pixels [N, 2] float32 in the image now, which points were tracked [N], and the mean grey
    difference of their windows [N].
    """
    before, now = images
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, *termination)
    track = functools.partial(
        cv2.calcOpticalFlowPyrLK,
        winSize=(window_px, window_px),
        maxLevel=num_levels - 1,
        criteria=criteria,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    start = pixels.astype(np.float32)
    guess = predicted.astype(np.float32)
    # OpenCV writes its result to the array of guesses
    tracked, status, error = track(before, now, start, guess.copy())
    returned, return_status, _ = track(now, before, tracked, tracked - (guess - start))
    is_tracked = np.linalg.norm(returned - start, axis=1) < max_return_px
    is_tracked &= (status.ravel() > 0) & (return_status.ravel() > 0)
    return tracked, is_tracked, error.ravel()
