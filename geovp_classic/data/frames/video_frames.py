"""Frames of a video file, decoded one after the other."""

import math
from functools import lru_cache
from pathlib import Path

import cv2

from geovp_classic import files
from geovp_classic.data.frames.image_frames import MAX_PIXELS
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray


class VideoFrames:
    """The frames of a video, decoded from its start up to the frame that is read.

    Seeking by number is not used, because the index of many containers is wrong. Frames are
    counted if the container does not state their number; a rate that it does not state is None.
    """

    def __init__(self, path: Path) -> None:
        """Open a video file; BadData if it cannot be decoded."""
        with files.opened(path):
            self.path = path
        self._restart()
        get = self._capture.get
        self.size_px = (
            int(get(cv2.CAP_PROP_FRAME_WIDTH)),
            int(get(cv2.CAP_PROP_FRAME_HEIGHT)),
        )
        if min(self.size_px) < 1 or math.prod(self.size_px) > MAX_PIXELS:
            raise BadData(
                f"{path} cannot be decoded as a video of at most {MAX_PIXELS:,} pixels: give a "
                "folder of images or another video file"
            )
        rate_hz = float(get(cv2.CAP_PROP_FPS))
        self.rate_hz = rate_hz if 0 < rate_hz < 1000 else None
        self._count = int(get(cv2.CAP_PROP_FRAME_COUNT))
        if self._count < 1:
            while self._capture.grab():
                self._next += 1
            self._count = self._next
        # a frame takes at least a byte
        if not 0 < self._count <= path.stat().st_size:
            raise BadData(
                f"{path} claims {self._count} frames, which its size cannot hold: restore the file"
            )
        self.read = lru_cache(maxsize=64)(self._decode)

    def __len__(self) -> int:
        return self._count

    def _restart(self) -> None:
        self._capture = cv2.VideoCapture(str(self.path))
        self._next = 0

    def _decode(self, index: int) -> ByteArray:
        """Return one frame; BadData if the video ends before it or is damaged there."""
        if index < self._next:
            self._restart()
        while self._next < index and self._capture.grab():
            self._next += 1
        image = self._capture.read()[1] if self._next == index else None
        if image is None or image.shape[1::-1] != self.size_px:
            raise BadData(
                f"{self.path}: frame {index} of {self._count} cannot be decoded: exclude it from "
                "the range"
            )
        self._next += 1
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
