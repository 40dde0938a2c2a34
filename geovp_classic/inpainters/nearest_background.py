"""Inpainting with the nearest background in the row of each pixel."""

from dataclasses import dataclass

from geovp_classic.geometry.occlusion import background_pixels
from geovp_classic.rendering.inpainting import inpaint_each
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Views


@dataclass(frozen=True)
class NearestBackground:
    """Inpainting from the farther one of the covered pixels left and right in the same row.

    A moving camera uncovers background. Of equally far pixels the nearer one is copied. Rows
    without any covered pixel are copied from the row above or below in the same manner; a frame
    without any becomes the last observed one.
    """

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Return frames [F, H, W, 3]."""
        return inpaint_each(views, last, self._inpaint_frame)

    def _inpaint_frame(self, frame: ByteArray, covered: BoolArray, depth: FloatArray) -> ByteArray:
        copied = background_pixels(covered, depth)[~covered]
        inpainted = frame.copy()
        inpainted[~covered] = frame.reshape(-1, 3)[copied]
        return inpainted
