"""Inpainting with the detail that the last observed frame has at the same pixels."""

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.inpainters.nearest_background import NearestBackground
from geovp_classic.interfaces import Inpainter
from geovp_classic.parallel import parallel_map
from geovp_classic.rendering.detail_transfer import wide_blur
from geovp_classic.rendering.grey_images import is_grey
from geovp_classic.types import ByteArray, FloatArray, Views


@dataclass(frozen=True)
class DetailTransfer:
    """Another inpainter's colours with the detail that the last observed frame has at the same
    pixels.

    A turning camera keeps seeing road below, walls and trees beside and the sky above: textures
    change less than objects. So low frequencies come from `colours`, and those finer than
    `coarse_share` of the image's width are transferred from the last frame, at `strength` of their
    contrast.
    """

    colours: Inpainter = field(default_factory=NearestBackground)
    coarse_share: float = 1 / 32
    strength: float = 0.25

    def __post_init__(self) -> None:
        if not (0 < self.coarse_share < 1 and self.strength >= 0):
            given = f"coarse_share {self.coarse_share} and strength {self.strength}"
            raise BadData(
                f"detail-transfer: {given}, expected a share between 0 and 1 and no negative "
                "strength"
            )

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3]."""
        filled = self.colours.inpaint(
            views, last
        ).copy()  # third-party inpainters may alias their input
        channels = slice(0, 1 if is_grey(last) and is_grey(filled) else 3)
        image = np.ascontiguousarray(last[..., channels], np.float32).squeeze()
        detail = (np.float32(self.strength) * (image - self._blur(image))).astype(np.float32)

        def add_detail(step: int) -> None:
            hidden = np.flatnonzero(~views.covered[step])
            broad = self._blur(
                np.ascontiguousarray(filled[step, ..., channels], np.float32).squeeze()
            )
            invented = (broad + detail).reshape(len(broad) * broad.shape[1], -1)[
                hidden
            ] + np.float32(0.5)
            filled[step].reshape(-1, 3)[hidden] = np.clip(invented, 0, 255).astype(np.uint8)

        parallel_map(add_detail, np.flatnonzero(~views.covered.all(axis=(1, 2))).tolist())
        return filled

    def _blur(self, image: FloatArray) -> FloatArray:
        return wide_blur(image, self.coarse_share * image.shape[1])
