"""Recorded depth as a depth source: the upper bound for the estimated ones."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.depth.completion import fill_from_background
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.types import Context, FloatArray, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class Given:
    """The recorded depth of the observed frames, in metres."""

    needs = PrivilegedInput.PAST_DEPTHS

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return inverse depth [P, H, W] per metre and confidence [P, H, W]: 1 where depth is
        recorded, 0 where it is unknown and filled from the background.

        Sky that touches a surface gets its depth: such pixels show the colours of both, and would
        stay in the sky as a pale ring when the camera approaches the surface.

        Incompatible when the clip has no depth or the poses are not in metres.
        """
        if context.past_depths is None:
            raise Incompatible(
                "given depth needs recorded depth, the clip has none: choose an estimating "
                "depth source"
            )
        if not past.is_metric:
            raise Incompatible(
                "recorded depth is in metres, the poses are not: give the odometry a scale"
            )
        depths = context.past_depths
        if not (depths >= 0).all():
            raise BadData(
                "recorded depth has negative numbers or NaN: write 0 where it is unknown, inf "
                "for the sky"
            )
        is_known = depths > 0
        inverse_depths = (is_known / np.where(is_known, depths, 1)).astype(np.float32)
        for step, inverse_depth in enumerate(inverse_depths):
            nearest_around = cv2.dilate(inverse_depth, np.ones((3, 3), np.uint8))
            touching = np.where(np.isinf(depths[step]), nearest_around, inverse_depth)
            inverse_depths[step] = fill_from_background(touching, is_known[step])
        return inverse_depths, is_known.astype(np.float32)
