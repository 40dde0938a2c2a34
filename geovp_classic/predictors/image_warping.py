"""Prediction by warping the last observed frame in the image plane, without geometry."""

from collections.abc import Sequence

import numpy as np

from geovp_classic.errors import Incompatible
from geovp_classic.interfaces import Inpainter
from geovp_classic.observation import observations_of
from geovp_classic.rendering.inpainting import inpainted_views
from geovp_classic.rendering.source import Source, to_bytes
from geovp_classic.types import BoolArray, ByteArray, Context, FloatArray, Prediction


def last_greys(context: Context) -> tuple[ByteArray, FloatArray, Source]:
    """Return grey images [2, H, W] and times [2] of the last usable frames, and the last frame.

    Raise Incompatible for fewer than two usable frames.
    """
    observations = observations_of(context, "crop")
    steps = np.flatnonzero(observations.is_usable)[-2:]
    if len(steps) < 2:
        raise Incompatible(
            f"image motion is measured in two frames, the past has {len(steps)} that are usable: "
            "give num_past of 2 or more"
        )
    last_frame = observations.frames[steps[-1]]
    source = Source(last_frame, observations.intrinsics, np.eye(4))
    return observations.greys[steps], context.times_s[steps], source


def warped_prediction(
    last: Source,
    # F maps: pixels [H, W, 2] float32 of the last frame, and which of them have a source [H, W]
    maps: Sequence[tuple[FloatArray, BoolArray]],
    inpainter: Inpainter,
) -> Prediction:
    """Sample the last frame for each future step; pixels outside of it are inpainted, too."""
    unknown_depth = np.zeros(last.frame.shape[:2], np.float32)
    views = []
    for pixels, has_source in maps:
        covered = last.is_visible(pixels, has_source.astype(np.float32))
        frame = to_bytes(last.sample(pixels, covered))
        views.append((frame, covered, unknown_depth))
    inpainted = inpainted_views(views, inpainter, last.frame)
    return Prediction(inpainted.frames[None], inpainted.covered[None])
