"""Inpainting with the detail that the last observed frame has at the same pixels."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.inpainters.nearest_background import NearestBackground
from geovp_classic.interfaces import Inpainter
from geovp_classic.parallel import parallel_map
from geovp_classic.rendering.magnified_detail import wide_blur
from geovp_classic.types import ByteArray, Views


@dataclass(frozen=True)
class DetailTransfer:
    """Colours of another inpainter with the detail that the last frame has at the same pixels.

    A turning camera keeps seeing road below, walls and trees at the sides and the sky above:
    textures change less than objects. So low frequencies come from `colours`, and higher ones from
    the last frame, at `strength` of their contrast. Detail belongs to the colour that it was seen
    with: a tree leaves no outline in the sky that replaces it.
    """

    colours: Inpainter = NearestBackground()
    # Of the image's width; detail is finer. Set by hand, 8 px of 256.
    coarse_fraction: float = 1 / 32
    strength: float = 0.25  # set by hand, below the .5 that was chosen on val for other detail
    # Grey values, rms of the channels: the difference of colours at which 1 / e of the detail is
    # left. Among 15, 30 and 60, chosen on KITTI's train and val and the videos of other cameras.
    colour_difference: float = 60.0

    def __post_init__(self) -> None:
        is_valid = 0 < self.coarse_fraction < 1 and self.strength >= 0
        is_valid &= self.colour_difference > 0
        if not is_valid:
            raise BadData(
                f"detail-transfer: coarse_fraction is {self.coarse_fraction}, strength "
                f"{self.strength} and colour_difference {self.colour_difference}, expected a "
                "fraction between 0 and 1, a strength of 0 or more and a positive difference"
            )

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Return frames [F, H, W, 3]."""
        inpainted = self.colours.inpaint(views, last)
        sigma_px = self.coarse_fraction * last.shape[1]
        observed = last.astype(np.float32)
        colours = wide_blur(observed, sigma_px)
        detail = self.strength * (observed - colours)

        def add_detail(step: int) -> ByteArray:
            covered = views.covered[step]
            # Nothing is missing, or all: then the view is the last frame, with all its detail
            if covered.all() or not covered.any():
                return inpainted[step]
            coarse = wide_blur(inpainted[step], sigma_px)
            square = cv2.transform((coarse - colours) ** 2, np.full((1, 3), 1 / 3))
            likeness = np.exp(-square / self.colour_difference**2)
            detailed = cv2.add(coarse, cv2.merge([likeness] * 3) * detail, dtype=cv2.CV_8U)
            is_covered = covered.astype(np.uint8)
            return cv2.copyTo(inpainted[step], is_covered, detailed)

        return np.stack(parallel_map(add_detail, range(len(inpainted))))
