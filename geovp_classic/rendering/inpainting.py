"""Inpainting of the uncovered pixels of each view by itself."""

from collections.abc import Callable

import numpy as np

from geovp_classic.parallel import parallel_map
from geovp_classic.types import BoolArray, ByteArray, FloatArray, IntArray, Views

# A frame [H, W, 3], its coverage and depth [H, W], and the flat indices [N] of uncovered pixels:
# their colours [N, 3]
InpaintFrame = Callable[[ByteArray, BoolArray, FloatArray, IntArray], ByteArray]


def inpaint_each(views: Views, last: ByteArray, inpaint_frame: InpaintFrame) -> ByteArray:
    """Inpaint view by view: `inpaint_frame` gives the colours [N, 3] of the pixels that are not
    covered.
    """
    filled = views.frames.copy()

    def inpaint_step(step: int) -> None:
        covered, colours = views.covered[step], filled[step].reshape(-1, 3)
        hidden = np.flatnonzero(~covered)
        if len(hidden) == covered.size:
            colours[:] = last.reshape(-1, 3)
        elif len(hidden):
            colours[hidden] = inpaint_frame(filled[step], covered, views.depths[step], hidden)

    parallel_map(inpaint_step, range(len(filled)))
    return filled
