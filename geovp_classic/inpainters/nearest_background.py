"""Inpainting with the nearest background on the line along which each pixel moves."""

from dataclasses import dataclass

from geovp_classic.geometry.occlusion import ALONG_ROWS, background_pixels
from geovp_classic.rendering.inpainting import inpaint_each
from geovp_classic.types import BoolArray, ByteArray, Views


@dataclass(frozen=True)
class NearestBackground:
    """Inpainting from the farther one of the covered pixels on both sides of a hole.

    A moving camera uncovers background along the motion of the image: along the lines through the
    vanishing point of its path, on which roads, kerbs and walls go on. The sides are those on this
    line, or in the row if the motion is unknown; of equally far pixels the nearer one is copied.
    Where the line has no covered pixel, the row has, or the column. A frame without any covered
    pixel becomes the last observed one.
    """

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Return frames [F, H, W, 3]."""

        def inpaint_frame(frame: ByteArray, covered: BoolArray, step: int) -> ByteArray:
            motion = ALONG_ROWS if views.last_from_view is None else views.last_from_view[step]
            copied = background_pixels(covered, views.depths[step], motion)[~covered]
            inpainted = frame.copy()
            inpainted[~covered] = frame.reshape(-1, 3)[copied]
            return inpainted

        return inpaint_each(views, last, inpaint_frame)
