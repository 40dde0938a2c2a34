"""Black pixels where a scene is not covered."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.types import ByteArray, Views


@dataclass(frozen=True)
class Blank:
    """Uncovered pixels stay black."""

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3], black where nothing is known."""
        return np.where(views.covered[..., None], views.frames, np.uint8(0))
