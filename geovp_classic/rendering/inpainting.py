"""Views whose uncovered pixels are inpainted."""

from collections.abc import Callable, Sequence

import numpy as np

from geovp_classic.interfaces import Inpainter
from geovp_classic.parallel import parallel_map
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Views

# From a frame [H, W, 3], its coverage [H, W] and its depth [H, W] to the inpainted frame, in which
# covered pixels are unchanged.
InpaintFrame = Callable[[ByteArray, BoolArray, FloatArray], ByteArray]


def inpainted_views(
    # F frames, coverages and depths
    views: Sequence[tuple[ByteArray, BoolArray, FloatArray]],
    inpainter: Inpainter,
    last: ByteArray,  # [H, W, 3], the last observed frame at the size of the views
) -> Views:
    """Return views with their uncovered pixels inpainted."""
    frames, covered, depths = (np.stack(maps) for maps in zip(*views, strict=True))
    stacked = Views(frames, covered, depths)
    return Views(inpainter.inpaint(stacked, last), covered, depths)


def inpaint_each(views: Views, last: ByteArray, inpaint_frame: InpaintFrame) -> ByteArray:
    """Inpaint view by view; a view without any covered pixel becomes the last frame."""

    def inpaint_step(step: int) -> ByteArray:
        frame = views.frames[step]
        covered = views.covered[step]
        if not covered.any():
            return last
        if covered.all():
            return frame
        return inpaint_frame(frame, covered, views.depths[step])

    return np.stack(parallel_map(inpaint_step, range(len(views.frames))))
