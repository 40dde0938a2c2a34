"""Black pixels where a scene is not covered."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.types import ByteArray, Views


@dataclass(frozen=True)
class Blank:
    """No inpainting: uncovered pixels are black."""

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Return frames [F, H, W, 3], black where they are not covered."""
        return np.where(views.covered[..., None], views.frames, np.uint8(0))
