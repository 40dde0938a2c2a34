"""Fast marching inpainting (Telea 2004)."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.rendering.inpainting import inpaint_each
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Views


@dataclass(frozen=True)
class Telea:
    """Fast marching inpainting (Telea 2004)."""

    radius_px: float = 3.0  # of the neighbourhood that is averaged, as in OpenCV's example

    def __post_init__(self) -> None:
        if not self.radius_px > 0:
            raise BadData(f"radius_px is {self.radius_px}, expected a positive number of pixels")

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Return frames [F, H, W, 3]; a frame without covered pixels becomes the last one."""
        return inpaint_each(views, last, self._inpaint_frame)

    def _inpaint_frame(self, frame: ByteArray, covered: BoolArray, depth: FloatArray) -> ByteArray:
        covered_frame = np.where(covered[..., None], frame, np.uint8(0))
        hole = (~covered).astype(np.uint8)
        return cv2.inpaint(covered_frame, hole, self.radius_px, cv2.INPAINT_TELEA)
