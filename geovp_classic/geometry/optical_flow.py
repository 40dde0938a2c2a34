"""Pyramidal Lucas-Kanade tracking of points with a forward-backward check (Lucas & Kanade 1981,
Kalal 2010).
"""

import cv2
import numpy as np

from geovp_classic.types import BoolArray, ByteArray, FloatArray


def track_points(
    images: tuple[ByteArray, ByteArray],  # [H, W] each, before and now
    pixels: FloatArray,  # [N, 2] in the image before, N >= 1
    predicted: FloatArray,  # [N, 2] in the image now, where the search starts
    window_px: int,
    num_levels: tuple[int, int] = (4, 4),  # of the pyramid, forward and backward
    termination: tuple[int, float] = (
        30,
        0.01,
    ),  # after so many iterations, or a step of so many pixels
    max_return_px: float = 0.5,
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Pixels [N, 2] float32 in the image now; which points were found [N]; mean grey difference of
    the windows [N].

    A point is found when tracking it back ends within `max_return_px` of its start.
    """
    before, now = images
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, *termination)
    window, flags = (window_px, window_px), cv2.OPTFLOW_USE_INITIAL_FLOW
    start, guess = np.asarray(pixels, dtype=np.float32), np.array(predicted, dtype=np.float32)
    forward, backward = num_levels
    there, found, error = cv2.calcOpticalFlowPyrLK(
        before,
        now,
        start,
        guess,
        winSize=window,
        maxLevel=forward - 1,
        criteria=criteria,
        flags=flags,
    )
    back, returned, _ = cv2.calcOpticalFlowPyrLK(
        now,
        before,
        there,
        start.copy(),
        winSize=window,
        maxLevel=backward - 1,
        criteria=criteria,
        flags=flags,
    )
    returns = np.linalg.norm(back - start, axis=1) < max_return_px
    kept = np.asarray(returns & (found.ravel() > 0) & (returned.ravel() > 0))
    return np.asarray(there, np.float32), kept, np.asarray(error, np.float32).ravel()
