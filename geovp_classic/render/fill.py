"""Fills: invent the pixels that a scene does not cover; covered pixels are never touched."""

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry.occlusion import background_pixels
from geovp_classic.interfaces import Fill
from geovp_classic.parallel import parallel_map
from geovp_classic.render.detail_transfer import wide_blur
from geovp_classic.render.grey_images import is_grey
from geovp_classic.types import BoolArray, ByteArray, FloatArray, IntArray, Views

# A frame [H, W, 3], its coverage and depth [H, W], and the flat indices [N] of what is not covered: its colours [N, 3]
FillOne = Callable[[ByteArray, BoolArray, FloatArray, IntArray], ByteArray]


@dataclass(frozen=True)
class Blank:
    """Uncovered pixels stay black."""

    def fill(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3], black where nothing is known."""
        return np.where(views.covered[..., None], views.frames, np.uint8(0))


@dataclass(frozen=True)
class NearestBackground:
    """An uncovered pixel takes the colour of the farther one of the covered pixels left and right of it in its row.

    A moving camera uncovers background. Of equally far pixels it is the nearer one. Rows without any covered
    pixel take the row above or below in the same manner; a frame without any is the last observed one.
    """

    def fill(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3]."""
        return _fill_each(views, last, self._fill_one)

    def _fill_one(self, frame: ByteArray, covered: BoolArray, depth: FloatArray, hidden: IntArray) -> ByteArray:
        return frame.reshape(-1, 3)[background_pixels(covered, depth).ravel()[hidden]]


@dataclass(frozen=True)
class Telea:
    """Fast marching inpainting (Telea 2004); `radius_px` is the neighbourhood it averages."""

    radius_px: float = 3.0

    def __post_init__(self) -> None:
        if not self.radius_px > 0:
            raise BadData(f"radius_px is {self.radius_px}, expected a positive number of pixels")

    def fill(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3]; a frame without any covered pixel is the last observed one."""
        return _fill_each(views, last, self._fill_one)

    def _fill_one(self, frame: ByteArray, covered: BoolArray, depth: FloatArray, hidden: IntArray) -> ByteArray:
        known, hole = np.where(covered[..., None], frame, np.uint8(0)), (~covered).astype(np.uint8)
        inpainted = cv2.inpaint(known, hole, self.radius_px, cv2.INPAINT_TELEA)
        return np.asarray(inpainted, np.uint8).reshape(-1, 3)[hidden]


@dataclass(frozen=True)
class BorrowedDetail:
    """Another fill's colours with the detail that the last observed frame has at the same pixels.

    A turning camera keeps seeing road below, walls and trees beside and the sky above: textures change less than
    objects. So low frequencies come from `colours`, and those finer than `coarse_share` of the image's width are
    transferred from the last frame, at `strength` of their contrast.
    """

    colours: Fill = field(default_factory=NearestBackground)
    coarse_share: float = 1 / 32
    strength: float = 0.25

    def __post_init__(self) -> None:
        if not (0 < self.coarse_share < 1 and self.strength >= 0):
            given = f"coarse_share {self.coarse_share} and strength {self.strength}"
            raise BadData(f"borrowed-detail: {given}, expected a share between 0 and 1 and no negative strength")

    def fill(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3]."""
        filled = self.colours.fill(views, last).copy()  # a fill of somebody else's may keep what it returns
        channels = slice(0, 1 if is_grey(last) and is_grey(filled) else 3)
        image = np.ascontiguousarray(last[..., channels], np.float32).squeeze()
        detail = (np.float32(self.strength) * (image - self._blur(image))).astype(np.float32)

        def add_detail(step: int) -> None:
            hidden = np.flatnonzero(~views.covered[step])
            broad = self._blur(np.ascontiguousarray(filled[step, ..., channels], np.float32).squeeze())
            invented = (broad + detail).reshape(len(broad) * broad.shape[1], -1)[hidden] + np.float32(0.5)
            filled[step].reshape(-1, 3)[hidden] = np.clip(invented, 0, 255).astype(np.uint8)

        parallel_map(add_detail, np.flatnonzero(~views.covered.all(axis=(1, 2))).tolist())
        return filled

    def _blur(self, image: FloatArray) -> FloatArray:
        return wide_blur(image, self.coarse_share * image.shape[1])


def _fill_each(views: Views, last: ByteArray, fill_one: FillOne) -> ByteArray:
    """Fill view by view: `fill_one` gives the colours [N, 3] of the pixels that are not covered."""
    filled = views.frames.copy()

    def fill_step(step: int) -> None:
        covered, colours = views.covered[step], filled[step].reshape(-1, 3)
        hidden = np.flatnonzero(~covered)
        if len(hidden) == covered.size:
            colours[:] = last.reshape(-1, 3)
        elif len(hidden):
            colours[hidden] = fill_one(filled[step], covered, views.depths[step], hidden)

    parallel_map(fill_step, range(len(filled)))
    return filled
