"""Recording from a webcam."""

import time
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.data.windows import Recording
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, Intrinsics


@dataclass(frozen=True)
class FramesInMemory:
    """A FrameReader of frames in memory."""

    frames: list[ByteArray]

    def __len__(self) -> int:
        return len(self.frames)

    def read(self, index: int) -> ByteArray:
        """Return a frame [H, W, 3]."""
        return self.frames[index]


def record(number: int, num_frames: int, min_step_s: float = 0.08) -> Recording:
    """Record frames of a webcam with their times, at most every min_step_s; BadData without it."""
    capture = cv2.VideoCapture(number)
    frames: list[ByteArray] = []
    times_s: list[float] = []
    try:
        while len(frames) < num_frames:
            is_read, image = capture.read()
            if not is_read:
                raise BadData(
                    f"webcam {number} gives no frames: connect it, or give a video or a folder"
                )
            now_s = time.monotonic()
            if not times_s or now_s - times_s[-1] >= min_step_s:
                frames.append(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8))
                times_s.append(now_s)
    finally:
        capture.release()
    height_px, width_px = frames[0].shape[:2]
    unknown = Intrinsics(width_px, width_px, 0.0, 0.0, width_px, height_px)
    times = np.array(times_s) - times_s[0]
    return Recording(f"webcam-{number}", FramesInMemory(frames), times, unknown)
