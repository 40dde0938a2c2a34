"""The uncropped frames in place of the square crops: a wider view, finer geometry
and all detail.
"""

import dataclasses
from typing import Literal

import numpy as np

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole
from geovp_classic.types import Context

MAX_SCALE = 1.5  # largest resolution for depth, over that of the square


def select(context: Context, frames: Literal["crop", "full"]) -> Context:
    """The context as it is, or with the uncropped images as its frames."""
    return uncropped(context) if frames == "full" else context


def uncropped(context: Context) -> Context:
    """The context with the uncropped images as its frames, up to MAX_SCALE times as fine as the
    square; `wide` stays.

    Incompatible when there are none, or when recorded depth of the square should be used with them.
    """
    if context.full is None:
        raise Incompatible(
            "uncropped frames are asked for, the clip has none: use a data set that gives wide "
            "frames"
        )
    if context.past_depths is not None:
        raise Incompatible(
            "recorded depth covers the square only: with uncropped frames choose an estimating "
            "source"
        )
    native, square = context.full.intrinsics, context.intrinsics
    scale = float(np.clip(native.fx_px / square.fx_px, 1, MAX_SCALE))
    width_px = max(1, round(native.width_px * scale * square.fx_px / native.fx_px))
    height_px = max(1, round(native.height_px * scale * square.fy_px / native.fy_px))
    frames = np.stack(
        [pinhole.resize(frame, (width_px, height_px)) for frame in context.full.frames]
    )
    return dataclasses.replace(
        context, frames=frames, intrinsics=native.resized(width_px, height_px)
    )
