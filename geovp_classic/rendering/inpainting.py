"""Views whose uncovered pixels are inpainted."""

from collections.abc import Callable, Sequence

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.interfaces import Inpainter
from geovp_classic.parallel import parallel_map
from geovp_classic.rendering.source import Source, resampled
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics, Views

# From a frame [H, W, 3], its coverage [H, W] and its step to the inpainted frame, in which covered
# pixels are unchanged.
InpaintFrame = Callable[[ByteArray, BoolArray, int], ByteArray]


def inpainted_views(
    # F frames, coverages and depths
    views: Sequence[tuple[ByteArray, BoolArray, FloatArray]],
    inpainter: Inpainter,
    last: Source,  # the last observed frame
    camera: Intrinsics,  # of the views
    world_from_cam: FloatArray | None = None,  # [F, 4, 4]; None: unknown
) -> Views:
    """Return views with their uncovered pixels inpainted."""
    frames, covered, depths = (np.stack(maps) for maps in zip(*views, strict=True))
    motions = None
    if world_from_cam is not None:
        motions = np.stack(
            [
                last_from_view(last, camera, pose, depth)
                for pose, depth in zip(world_from_cam, depths, strict=True)
            ]
        )
    stacked = Views(frames, covered, depths, last_from_view=motions)
    return Views(inpainter.inpaint(stacked, resampled(last, camera)), covered, depths)


def last_from_view(
    last: Source,
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [4, 4]
    depth: FloatArray,  # [H, W] of the view, 0 where it is unknown
) -> FloatArray:
    """Return the homography [3, 3] from the pixels of a view to those of the last frame.

    It is that of a plane that faces the view, at the median of its inverse depths.
    """
    last_from_cam = se3.inverse(last.world_from_source) @ world_from_cam
    epipolar = Epipolar.of(camera, last_from_cam, last.camera)
    is_known = depth > 0
    inverse_depth = np.median(1 / depth[is_known]) if is_known.any() else 0.0
    homography = epipolar.infinity.astype(np.float64)
    homography[:, 2] += inverse_depth * epipolar.epipole
    return homography


def inpaint_each(views: Views, last: ByteArray, inpaint_frame: InpaintFrame) -> ByteArray:
    """Inpaint view by view; a view without any covered pixel becomes the last frame."""

    def inpaint_step(step: int) -> ByteArray:
        frame = views.frames[step]
        covered = views.covered[step]
        if not covered.any():
            return last
        if covered.all():
            return frame
        return inpaint_frame(frame, covered, step)

    return np.stack(parallel_map(inpaint_step, range(len(views.frames))))
