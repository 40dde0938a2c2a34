"""Views whose uncovered pixels are inpainted."""

from collections.abc import Callable, Sequence

import numpy as np

from geovp_classic.interfaces import Inpainter
from geovp_classic.parallel import parallel_map
from geovp_classic.types import BoolArray, ByteArray, FloatArray, IntArray, Views

# From a frame [H, W, 3], its coverage [H, W], its depth [H, W] and the flat indices [N] of its
# uncovered pixels to their colours [N, 3].
InpaintFrame = Callable[[ByteArray, BoolArray, FloatArray, IntArray], ByteArray]


def inpainted_views(
    views: Sequence[tuple[ByteArray, BoolArray, FloatArray]],  # F frames, coverages and depths
    inpainter: Inpainter,
    last: ByteArray,  # [H, W, 3], the last observed frame at the size of the views
) -> Views:
    """Return views with their uncovered pixels inpainted."""
    frames, covered, depths = (np.stack(maps) for maps in zip(*views, strict=True))
    stacked = Views(frames, covered, depths)
    return Views(inpainter.inpaint(stacked, last), covered, depths)


def inpaint_each(views: Views, last: ByteArray, inpaint_frame: InpaintFrame) -> ByteArray:
    """Inpaint view by view; a view without any covered pixel becomes the last frame."""
    inpainted = views.frames.copy()

    def inpaint_step(step: int) -> None:
        covered = views.covered[step]
        colours = inpainted[step].reshape(-1, 3)
        hidden = np.flatnonzero(~covered)
        if len(hidden) == covered.size:
            colours[:] = last.reshape(-1, 3)
        elif len(hidden):
            colours[hidden] = inpaint_frame(inpainted[step], covered, views.depths[step], hidden)

    parallel_map(inpaint_step, range(len(inpainted)))
    return inpainted
