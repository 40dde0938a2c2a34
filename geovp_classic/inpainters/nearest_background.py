"""Inpainting with the nearest background in the row of each pixel."""

from dataclasses import dataclass

from geovp_classic.geometry.occlusion import background_pixels
from geovp_classic.rendering.inpainting import inpaint_each
from geovp_classic.types import BoolArray, ByteArray, FloatArray, IntArray, Views


@dataclass(frozen=True)
class NearestBackground:
    """An uncovered pixel takes the colour of the farther one of the covered pixels left and right
    of it in its row.

    A moving camera uncovers background. Of equally far pixels it is the nearer one. Rows without
    any covered pixel take the row above or below in the same manner; a frame without any is the
    last observed one.
    """

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3]."""
        return inpaint_each(views, last, self._inpaint_frame)

    def _inpaint_frame(
        self, frame: ByteArray, covered: BoolArray, depth: FloatArray, hidden: IntArray
    ) -> ByteArray:
        return frame.reshape(-1, 3)[background_pixels(covered, depth).ravel()[hidden]]
